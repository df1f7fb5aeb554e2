"""The search as a whole, on a simulated serve."""

import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from core.config import config_to_mapping, get_setting, replace_setting
from core.detection import DetectorConfig
from core.detection.window import EarlyEnds
from core.errors import CommandError, ConfigError, RecordingError
from core.jobs import JobBackend
from core.metrics.grid_score import GridScore
from core.recordings import Recording, open_recording
from core.tuning import TuningConfig, choose_parameters, report_of, truth_objective, tune
from core.tuning.objective import WORST, Cancelled, SplitScore, TruthObjective, figures_of
from core.tuning.tune import TuningProgress, TuningResult

pytestmark = pytest.mark.numeric
BAD = replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.9)
"""Refuses most balls."""
NAMES = ("geometry.circularity_min", "localise.radius_min_px", "localise.radius_max_px")


@pytest.fixture(scope="module")
def recording(serve_recording: Path) -> Iterator[Recording]:
    with open_recording(serve_recording) as recording:
        yield recording


@pytest.fixture(scope="module")
def objective(serve_recording: Path, recording: Recording) -> TruthObjective:
    return truth_objective(serve_recording, recording, ("left",), "auto", BAD)


def search(objective: TruthObjective, *, trials: int = 17, jobs: int = 1, **more) -> TuningResult | None:
    parameters = choose_parameters("auto", BAD, NAMES)
    return tune(objective, "auto", BAD, parameters, TuningConfig(trials=trials), engine=JobBackend(jobs=jobs), **more)


@pytest.fixture(scope="module")
def found(objective: TruthObjective) -> TuningResult:
    result = search(objective)
    assert result is not None
    return result


def objective_of(objective: TruthObjective, recording: Recording, config: DetectorConfig) -> float:
    return figures_of(objective.score(recording, config, lambda: False).tuned).objective


def test_a_worse_detector_scores_worse(objective: TruthObjective, recording: Recording) -> None:
    blind = replace_setting(DetectorConfig(), ("cluster", "size_max"), 40)
    good, bad, none = (objective_of(objective, recording, config) for config in (DetectorConfig(), BAD, blind))
    assert good > bad + 0.05 > bad > none == WORST


def test_windows_that_end_early_are_scored_as_such(
    serve_recording: Path, recording: Recording, objective: TruthObjective
) -> None:
    ends = EarlyEnds(motion_px=1.0)
    early = truth_objective(serve_recording, recording, ("left",), "auto", BAD, ends=ends)
    usual, shorter = (objective_of(one, recording, DetectorConfig()) for one in (objective, early))
    assert shorter < usual - 0.05, "this method needs the events of a longer window"


def test_both_sides_ask_for_balls_and_share_none(objective: TruthObjective, recording: Recording) -> None:
    score = objective.score(recording, DetectorConfig(), lambda: False)
    assert score.tuned.asked > 50 and score.held_out.asked > 50
    whole = (score.tuned + score.held_out).asked
    truth = recording.cameras["left"].truth
    assert truth is not None and whole <= truth.visible[::2].sum(), "once a millisecond"


def test_longer_windows_are_not_better_for_being_longer(serve_recording: Path, recording: Recording) -> None:
    near = truth_objective(serve_recording, recording, ("left",), "auto", DetectorConfig())
    longer = replace_setting(DetectorConfig(), ("window", "window_us"), 20_000)
    assert near.score(recording, longer, lambda: False).tuned.recall < 0.5


def test_in_time_a_longer_way_to_the_robot_and_a_longer_window_are_worse(
    serve_recording: Path, recording: Recording
) -> None:
    def worth(added_us: int | None, window_us: int) -> float:
        start = replace_setting(DetectorConfig(), ("window", "window_us"), window_us)
        asked = truth_objective(serve_recording, recording, ("left",), "auto", DetectorConfig(), added_us=added_us)
        return objective_of(asked, recording, start)

    assert worth(None, 2000) > worth(0, 2000) > worth(20_000, 2000)
    assert worth(0, 2000) > worth(0, 4000)


def test_it_finds_something_better_and_the_start_is_trial_0(
    found: TuningResult, objective: TruthObjective, recording: Recording
) -> None:
    assert found.start == BAD and found.best_trial > 0 and not found.stopped and len(found.trials) == 17
    first, best = found.trials[0], found.trials[found.best_trial]
    assert first.tuned.objective == objective_of(objective, recording, BAD)
    assert best.tuned.objective == max(trial.tuned.objective for trial in found.trials) > first.tuned.objective
    assert objective_of(objective, recording, found.best) == best.tuned.objective, "the config is that of the trial"
    assert "geometry.circularity_min" in found.changed
    unchanged = {name: get_setting(BAD, tuple(name.split("."))) for name in NAMES if name not in found.changed}
    assert all(best.values[name] == value for name, value in unchanged.items())


def test_only_what_was_named_is_changed(found: TuningResult) -> None:
    before, after = config_to_mapping(BAD), config_to_mapping(found.best)
    assert {section for section in before if before[section] != after[section]} <= {"geometry", "localise"}


@pytest.mark.gate
def test_the_answer_is_the_same_to_the_last_bit_however_many_processes_score(
    found: TuningResult, objective: TruthObjective
) -> None:
    of_others = set(multiprocessing.active_children())
    others = search(objective, jobs=2)
    assert others is not None and repr(others) == repr(found)
    assert set(multiprocessing.active_children()) <= of_others


def test_progress_counts_up_to_all_trials_and_knows_the_best(objective: TruthObjective) -> None:
    states: list[TuningProgress] = []
    result = search(objective, trials=4, progress=states.append)
    assert result is not None
    counts = [state.done for state in states]
    assert counts == sorted(counts) and counts[-1] == states[-1].trials == 4
    assert states[0].best is None and states[-1].best == result.trials[result.best_trial]


def test_a_search_that_is_ended_has_its_whole_batches(found: TuningResult, objective: TruthObjective) -> None:
    seen = 0

    def look(state: TuningProgress) -> None:
        nonlocal seen
        seen = state.done

    result = search(objective, progress=look, cancelled=lambda: seen > 11)
    assert result is not None and result.stopped
    assert repr(result.trials) == repr(found.trials[:9]), "the start and one batch of 8"
    assert search(objective, cancelled=lambda: True) is None


def test_processes_that_are_ended_leave_none_behind(objective: TruthObjective) -> None:
    seen, of_others = 0, set(multiprocessing.active_children())

    def look(state: TuningProgress) -> None:
        nonlocal seen
        seen = state.done

    result = search(objective, jobs=2, progress=look, cancelled=lambda: seen > 0)
    assert result is None or result.stopped
    assert set(multiprocessing.active_children()) <= of_others


class Counting:
    """Knows that small circularities are good, and counts how often it is asked."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.configs: list[DetectorConfig] = []

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        self.configs.append(config)
        found = round(100 * (1 - config.geometry.circularity_min))
        side = GridScore(100, found, found, 0, np.zeros(found))
        return SplitScore(side, side)


def test_impossible_values_are_worst_and_not_run_and_no_config_is_run_twice(serve_recording: Path) -> None:
    start = replace_setting(DetectorConfig(), ("localise", "radius_max_px"), 5.0)  # and at least 4
    counting = Counting(serve_recording)
    parameters = choose_parameters("auto", start, ["localise", "geometry.circularity_min"])
    result = tune(counting, "auto", start, parameters, TuningConfig(trials=33))
    assert result is not None
    impossible = [trial for trial in result.trials if not trial.possible]
    assert impossible and all(trial.tuned.objective == WORST for trial in impossible)
    assert len(counting.configs) == len(set(counting.configs)) <= 33 - len(impossible)
    assert report_of(result)["impossible"] == len(impossible)


def test_a_recording_without_truth_is_refused(serve_recording: Path, recording: Recording, tmp_path: Path) -> None:
    from core.events import Events
    from core.recordings import RecordingWriter

    sensor = recording.cameras["left"].sensor
    with RecordingWriter(tmp_path / "bare.h5", {"left": sensor}) as writer:
        writer.append("left", Events.empty(sensor))
    with open_recording(tmp_path / "bare.h5") as bare, pytest.raises(RecordingError, match="no ground truth"):
        truth_objective(tmp_path / "bare.h5", bare, ("left",), "auto", BAD)


def test_without_parameters_there_is_nothing_to_search(objective: TruthObjective) -> None:
    with pytest.raises(ConfigError, match="no parameters"):
        tune(objective, "auto", BAD, ())


def test_without_optuna_the_remedy_is_said(objective: TruthObjective, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.delitem(sys.modules, "core.tuning.search", raising=False)
    with pytest.raises(CommandError, match=r"tuning needs optuna; pip install 'rallyscope\[tune\]'"):
        search(objective)
