import json
import types

import pytest

from app.cli import bench, main
from app.cli.backend_arguments import BackendArguments
from benchmarks.machine import report_rows_to


def arguments(*, json: bool) -> bench.BenchArguments:
    engine = BackendArguments(jobs=None, cluster=None)
    return bench.BenchArguments(name="detection", **dict.fromkeys(bench.OPTIONS), engine=engine, json=json)  # type: ignore[arg-type]


def test_json_is_what_the_bench_returns(monkeypatch, capsys) -> None:
    report = {"rows": [{"a": 1.5}], "machine": {"cpu": "x"}}
    module = types.SimpleNamespace(run=lambda progress: progress(1.0) or report)
    monkeypatch.setattr(bench.importlib, "import_module", lambda name: module)
    bench.run(arguments(json=True))
    assert json.loads(capsys.readouterr().out) == report
    bench.run(arguments(json=False))
    assert capsys.readouterr().out.splitlines() == ["    a", "1.500", 'machine: {"cpu": "x"}']


def test_rows_are_said_as_they_are_measured(monkeypatch, capsys) -> None:
    rows = [{"scene": "ball", "ratio": 1.5}, {"scene": "dark", "ratio": 2.0}]

    def measure(progress) -> dict[str, object]:
        report_rows_to(progress, rows[:1], 0.5)
        assert capsys.readouterr().err == "scene ball, ratio 1.500\n"  # before the second is measured
        report_rows_to(progress, rows[1:], 1.0)
        return {"rows": rows}

    monkeypatch.setattr(bench.importlib, "import_module", lambda name: types.SimpleNamespace(run=measure))
    bench.run(arguments(json=True))
    said = capsys.readouterr()
    assert said.err == "scene dark, ratio 2.000\n" and json.loads(said.out) == {"rows": rows}


@pytest.mark.parametrize("verb", [["bench", "prediction"], ["train-detector", "yolo", "--out", "weights"]])
def test_without_a_checkout_it_says_where_the_benches_are(verb: list[str], monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr(bench, "CHECKOUT", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(verb) == 2
    assert not list(tmp_path.iterdir()), "nothing is begun"
    error = capsys.readouterr().err
    assert "not installed with the package" in error and "clone the repository" in error and error.count("\n") == 1


def test_every_bench_has_a_module_in_the_checkout() -> None:
    for name in [*bench.BENCHES.values(), *bench.OWN_RECORDINGS.values()]:
        assert bench.CHECKOUT.joinpath("benchmarks", *name.split(".")).with_suffix(".py").is_file(), name


def test_an_unknown_bench_is_refused_in_one_line(capsys) -> None:
    assert main(["bench", "coffee"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("arguments", [["rally", "--count", "3"], ["drawn-scenes", "--count", "0"]])
def test_a_count_is_for_benches_that_have_one(arguments, capsys) -> None:
    assert main(["bench", *arguments]) == 2
    error = capsys.readouterr().err
    assert "--count" in error and error.count("\n") == 1


@pytest.mark.parametrize("flag", [("--jobs", "2"), ("--cluster", "tcp://127.0.0.1:8786")])
def test_a_bench_that_is_not_many_pieces_takes_no_engine(flag: tuple[str, str], capsys) -> None:
    assert main(["bench", "detection", *flag]) == 2
    assert f"`bench detection` has no such option; got {flag[0]}" in capsys.readouterr().err


def test_a_plain_cluster_beyond_this_machine_is_refused_in_one_line(capsys) -> None:
    assert main(["bench", "learning", "--cluster", "tcp://10.0.0.7:8786"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "needs certificates" in error and "tls://" in error
    assert main(["bench", "learning", "--cluster", "tcp://127.0.0.1:8786", "--jobs", "2"]) == 2
    assert "not both" in capsys.readouterr().err


def test_a_flag_that_was_not_given_is_asked_of_no_bench() -> None:
    module, options = bench.requested_bench(arguments(json=False))
    assert module.__module__.endswith("bench_detection") and options == {}
