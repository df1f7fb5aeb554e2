"""The seeds of a run side by side: what is counted into the mean, and what is said."""

import numpy as np
import pytest

from app.modes.train.seeds.seed_results import LISTED_SEEDS, seed_results, seed_results_html
from app.modes.train.view import RunsViewer, ViewRequest
from app.shared.training.metrics import MetricsStore
from app.shared.training.trainer import Trainer
from app.shared.workspace import Workspace
from core.learning.runs.run_files import read_lines, seed_files


def line(episode: int, returned: float, error_mm: float | None, speed_mps: float = 5.0) -> dict[str, object]:
    return {"episode": episode, "speed_mps": speed_mps, "returned": returned, "error_mm": error_mm}


def test_a_finished_run_tells_the_mean_of_its_seeds_with_the_interval(trained: Workspace) -> None:
    details = RunsViewer(trained, Trainer(trained), MetricsStore())(ViewRequest("small", None)).details
    assert details is not None and details.seed_results is not None
    results = details.seed_results
    ends = [read_lines(seed_files(trained.run_path("small"), seed).evaluations)[0][-1] for seed in (0, 1)]
    errors = [float(str(end["error_mm"])) for end in ends]
    assert [one.error_mm for one in results.seeds] == errors and results.counted == 2
    assert results.error_mm.mean == pytest.approx(np.mean(errors))
    half = 12.7062 * abs(errors[0] - errors[1]) / 2  # t of one degree of freedom, times the standard error of two
    assert results.error_mm.high - results.error_mm.mean == pytest.approx(half, rel=1e-4)


def test_seeds_on_their_way_are_not_counted_with_those_that_went_farther() -> None:
    evaluations = {
        0: (line(50, 0.2, 500.0), line(100, 1.0, 30.0)),
        1: (line(100, 0.9, 50.0),),
        2: (line(50, 0.1, 900.0),),
    }
    under_way = seed_results(evaluations, finished=False)
    assert under_way is not None and under_way.counted == 2 and under_way.error_mm.mean == 40.0
    assert [one.episode for one in under_way.seeds] == [100, 100, 50]
    over = seed_results(evaluations, finished=True)  # stages that converge early end after fewer balls
    assert over is not None and over.counted == 3 and over.returned.mean == pytest.approx(100 * 2.0 / 3)
    slower = {0: (line(100, 1.0, 30.0, 3.0),), 1: (line(100, 1.0, 90.0, 5.0),)}
    assert seed_results(slower, finished=False).counted == 1  # type: ignore[union-attr]


def test_nothing_is_said_of_one_seed_or_before_the_first_evaluation() -> None:
    assert seed_results({0: (line(50, 1.0, 30.0),)}, finished=True) is None
    assert seed_results({0: (), 1: ()}, finished=False) is None and seed_results_html(None) == ""


def test_the_rows_name_seeds_mean_and_interval_and_an_interval_needs_two() -> None:
    text = seed_results_html(seed_results({3: (line(100, 1.0, 30.0),), 4: (line(100, 0.98, 50.0),)}, finished=True))
    for words in ("100.0 %", "98.0 %", "30 mm", "50 mm", "mean of 2", "99.0 %", "40 mm", "Student's t", "0 to 167"):
        assert words in text, words
    assert "86.3 to 100.0" in text  # no share is above 100 %
    alone = seed_results_html(seed_results({0: (line(100, 1.0, None),), 1: ()}, finished=False))
    assert "mean of 1" in alone and "interval</td>" not in alone and "<td" in alone and "nan" not in alone
    many = seed_results_html(seed_results({n: (line(9, 1.0, 1.0),) for n in range(LISTED_SEEDS + 3)}, finished=True))
    assert "and 3 seeds before" in many and many.count("<tr>") == LISTED_SEEDS + 3


def test_damaged_numbers_do_no_harm() -> None:
    broken = seed_results({0: ({"episode": "x", "returned": 1e300},), 1: (line(10, 1.0, 5.0),)}, finished=True)
    assert broken is not None and "nan" not in seed_results_html(broken)
