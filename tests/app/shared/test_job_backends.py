"""Where work is done is chosen by a word; the address is the command line's."""

from pathlib import Path

import pytest

from app.cli import main
from app.shared import trainer as trainer_module
from app.shared.job_backends import THE_CLUSTER, THIS_MACHINE, JobBackends
from app.shared.trainer import Trainer
from app.shared.workspace import Workspace
from core.errors import CommandError, JobsError
from core.learning import default_run

ADDRESS = "tcp://127.0.0.1:8786"


def test_without_a_cluster_there_is_nothing_to_choose() -> None:
    places = JobBackends()
    assert places.offered == (THIS_MACHINE,) and places.flags(THIS_MACHINE, 3) == ("--jobs", "3")
    with pytest.raises(CommandError, match="no such backend"):
        places.flags(THE_CLUSTER, 1)


def test_a_browser_names_the_cluster_and_never_its_address() -> None:
    places = JobBackends(ADDRESS)
    assert places.offered == (THIS_MACHINE, THE_CLUSTER)
    assert places.flags(THE_CLUSTER, 3) == ("--cluster", ADDRESS) and places.flags(THIS_MACHINE, 1) == ("--jobs", "1")
    for place in ("tcp://192.0.2.1:8786", "", "--cluster"):
        with pytest.raises(CommandError, match="no such backend"):
            places.flags(place, 1)


def test_a_plain_cluster_elsewhere_is_refused_before_anything_is_opened(capsys, tmp_path: Path) -> None:
    with pytest.raises(JobsError, match="certificates"):
        JobBackends("tcp://192.0.2.1:8786")
    assert main(["serve", "--cluster", "tcp://192.0.2.1:8786", "--data", str(tmp_path / "data")]) == 2
    error = capsys.readouterr().err
    assert "needs certificates" in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "data").exists()


def test_a_run_is_trained_and_gone_on_with_where_it_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    launched: list[list[str]] = []

    class Ended:
        returncode = 1

        def __init__(self, words: list[str], **_: object) -> None:
            launched.append(words)

        def poll(self) -> int:
            return 1

        def wait(self) -> int:
            return 1

    monkeypatch.setattr(trainer_module.subprocess, "Popen", Ended)
    trainer = Trainer(Workspace(tmp_path), JobBackends(ADDRESS))
    config = default_run("landing-model")
    trainer.start("far", config, None, THE_CLUSTER)
    trainer.resume("far")
    trainer.start("near", config, None)
    with pytest.raises(CommandError, match="no such backend"):
        trainer.start("nowhere", config, None, "tcp://192.0.2.1:1")
    where = [words[words.index("--resume") + 1 : words.index("--out")] for words in launched]
    assert where == [["--cluster", ADDRESS], ["--cluster", ADDRESS], ["--jobs", "1"]]
    assert "nowhere" not in Workspace(tmp_path).run_names()
