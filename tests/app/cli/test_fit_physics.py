"""`rallyscope fit-physics`."""

import json

import numpy as np
import pytest

from app.cli import main
from core.physics.constants_file import read_constants
from core.physics.fit_flights import simulate_flight, with_constants

pytestmark = pytest.mark.numeric


@pytest.fixture
def files(tmp_path) -> list[str]:
    physics, rng = with_constants(0.1, 0.45, 0.9, 0.25), np.random.default_rng(1)
    t_s = np.arange(0.0, 0.55, 1 / 150)
    paths = []
    for number in range(6):
        start = np.array([1.1, 0, 0.3, *rng.normal((-5, 0, 1), 0.4), *rng.normal(0, 80, 3)])
        rows = np.column_stack([t_s, simulate_flight(start, t_s, physics)])
        path = tmp_path / f"{number}.csv"
        np.savetxt(path, rows, delimiter=",", header="t_s,x_m,y_m,z_m", comments="", fmt="%.6f")
        paths.append(str(path))
    return paths


def test_it_prints_what_it_found_and_how_well_it_predicts(files, tmp_path, capsys) -> None:
    written = tmp_path / "constants.json"
    assert main(["fit-physics", *files, "--samples", "2", "--json", "--out", str(written)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert json.loads(written.read_text()) == report
    fitted = read_constants(written)  # what `--constants` of other verbs reads
    assert fitted.drag_coefficient == (report["drag_coefficient"]["value"], report["drag_coefficient"]["sigma"])
    assert report["drag_coefficient"]["value"] == pytest.approx(0.45, abs=0.03)
    assert report["restitution"]["value"] == pytest.approx(0.9, abs=0.02)
    assert report["flights"] == {"fit": 4, "test": 2}
    assert [row["model"] for row in report["test"]] == ["gravity", "drag", "drag + Magnus"]
    assert [row["method"] for row in report["predictors"]] == ["filter", "paper"]


@pytest.mark.parametrize(
    ("change", "message"),
    [(["--magnus", "3"], "coefficient"), (["--samples", "1"], "count"), (["no-such.csv"], "no-such.csv")],
)
def test_bad_input_is_one_clear_line(files, change: list[str], message: str, capsys) -> None:
    assert main(["fit-physics", *files, *change]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_too_few_flights_are_refused(files, capsys) -> None:
    assert main(["fit-physics", *files[:3]]) == 2
    assert "4 or more" in capsys.readouterr().err
