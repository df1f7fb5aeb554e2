"""What is said about a run."""

import dataclasses
from pathlib import Path

import pytest

from app.modes.train.status import (
    kept_html,
    log_html,
    plan_text,
    rule_text,
    runs_html,
    status_html,
    time_text,
    why_no_ball,
)
from app.modes.train.view import Details, RunsViewer, ViewRequest
from app.scene.prediction import CASE_NAMES
from app.shared.trainer import Ended, RunPhase, RunState, Trainer, judge_run
from app.shared.training_records import MetricsStore
from app.shared.workspace import Workspace
from core.learning.config import CurriculumConfig
from core.learning.randomisation import RandomisationConfig
from core.learning.runs.run_files import RunStatus, create_run, hold_run, read_lines, seed_files, write_status
from core.physics.episode import Case
from tests.app.modes.train.conftest import train_here
from tests.app.modes.train.small_runs import small_run

CONFIG = small_run(speeds_mps=(3.0, 5.0), episodes=(10, 20), seeds=2)
STATUS = RunStatus("running", 1, 0, 5, 30, 0.2, 3.0, 100.0)
STATE = RunState("mine", CONFIG, "running", STATUS, None, 0.0)
DETAILS = Details(  # its pictures are not asked for
    charts=None, counts={}, plan_png=b"", offsets_png=b"", spots=(), recent=(), evaluations=(), returned=96.0,
    error_mm=80.0, episodes_done=30, seed=0,
)  # type: ignore[arg-type]  # fmt: skip
DEAD_PID = 2**22 + 1
"""Larger than any process number."""


def test_before_the_first_training_a_newcomer_is_told_what_to_do() -> None:
    assert "Train now" in status_html(None, None, None)
    assert why_no_ball(None, None) == "the table, without a ball"


@pytest.mark.parametrize(
    ("phase", "recent", "why"),
    [
        ("running", (), "no ball yet"),
        ("finished", ({"episode": 1},), "no ball yet"),  # it is worked out
        ("stopped", (), "this run has played no ball"),
    ],
)
def test_a_ball_is_promised_only_where_one_is_to_come(phase: RunPhase, recent: tuple, why: str) -> None:
    run, details = dataclasses.replace(STATE, phase=phase), dataclasses.replace(DETAILS, recent=recent)
    assert why_no_ball(run, details) == why


def test_a_plan_is_said_in_one_line() -> None:
    plain = "landing-model, cdta reward, 10 at 3 m/s, 20 at 5 m/s, 2 seeds"
    assert plan_text(STATE) == plain
    randomise = RandomisationConfig(latency=True, rubber=True)
    environment = dataclasses.replace(CONFIG.environment, randomise=randomise, racket="uncertain")
    state = dataclasses.replace(STATE, config=dataclasses.replace(CONFIG, environment=environment))
    assert plan_text(state) == f"{plain}; another with every ball: latency, rubber, racket"


def test_a_finished_run_sums_up_what_was_learned(tmp_path: Path) -> None:
    line = {"episode": 30, "speed_mps": 5.0, "returned": 0.996, "error_mm": 21.6}
    details = dataclasses.replace(DETAILS, evaluations=(line,), episodes_done=30)
    running = status_html(STATE, details, None)
    assert "last balls, with exploration noise: " in running
    assert "policy after 30: 100 % returned, 22 mm from the target" in running and "Learned" not in running
    assert "ball 30 of 30, seed 0, stage 1 of 2, 3 m/s" in running
    second = dataclasses.replace(details, stage_starts=({"kept": 8, "dropped": 2, "stage": 1, "speed_mps": 5.0},))
    assert "stage 2 of 2" in status_html(STATE, second, None)
    done = dataclasses.replace(STATE, phase="finished")
    learned = "Learned: it returns 100 % of the balls at 5 m/s, 22 mm from the target, after 30 balls."
    assert learned in status_html(done, details, None)
    nothing = dataclasses.replace(details, evaluations=({**line, "error_mm": None},))
    assert "Learned" not in status_html(done, nothing, None)


def test_a_failure_is_shown_with_its_reason_and_never_as_markup() -> None:
    failed = dataclasses.replace(STATE, phase="failed", message="<script>", name="mine")
    shown = status_html(failed, None, None)
    assert "<script>" not in shown and "&lt;script&gt;" in shown
    assert "<img" not in log_html(("<img src=x>",), None)


def test_another_run_that_is_being_trained_is_named() -> None:
    other = dataclasses.replace(STATE, name="other")
    assert "other is being trained" in status_html(STATE, None, other)
    assert "is being trained" not in status_html(STATE, None, STATE)


def test_the_list_of_runs_tells_how_good_each_is() -> None:
    other = dataclasses.replace(STATE, name="other")
    shown = runs_html((STATE, other), {"mine": {"speed_mps": 5.0, "returned": 0.99, "error_mm": 21.6}})
    assert "99 %" in shown and "22 mm" in shown and "other" in shown and "nan" not in shown
    assert shown.count("white-space:nowrap") == 3 * 5, "no cell breaks at a space or a hyphen"


@pytest.mark.parametrize(("seconds", "text"), [(5, "5 s"), (600, "10 min"), (7200, "2.0 h")])
def test_durations_are_said_as_people_do(seconds: float, text: str) -> None:
    assert time_text(seconds) == text


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    create_run(folder, CONFIG)
    return folder


def judge(run, ended: Ended | None = None, *, child: int | None = None, stopping: bool = False) -> RunState:
    return judge_run(run, CONFIG, child_lives=child is not None, child_pid=child, stopping=stopping, ended=ended)


def test_a_run_is_starting_until_its_process_has_spoken(run) -> None:
    assert judge(run).phase == "new"
    assert judge(run, child=7).phase == "starting"
    write_status(run, dataclasses.replace(STATUS, pid=7))
    assert judge(run, child=7).phase == "running"
    assert judge(run, child=7, stopping=True).phase == "stopping"
    write_status(run, dataclasses.replace(STATUS, state="finished", pid=7))
    assert judge(run, child=7).phase == "ending" and judge(run).phase == "finished"


def test_a_run_whose_process_number_is_now_anothers_has_failed(run) -> None:
    write_status(run, dataclasses.replace(STATUS, pid=1))  # alive, but it does not hold the run
    assert judge(run).phase == "failed"
    with hold_run(run):
        assert judge(run).phase == "running"


def test_a_run_that_ends_elsewhere_while_it_is_judged_is_finished_and_has_not_failed(run, monkeypatch) -> None:
    """Its process writes its last status, then lets the run go: between the two looks of another app."""
    write_status(run, dataclasses.replace(STATUS, pid=1))

    def ends_now(run: Path) -> bool:
        write_status(run, dataclasses.replace(STATUS, state="finished", pid=1))
        return False

    monkeypatch.setattr("app.shared.trainer.is_held", ends_now)
    assert judge(run).phase == "finished"


@pytest.mark.parametrize(
    ("ended", "said"),
    [
        (Ended(-9, ()), "killed (SIGKILL)"),
        (Ended(2, ("noise", "rallyscope: not a checkpoint")), "not a checkpoint"),
        (Ended(1, ("Traceback",)), "exit code 1"),
    ],
)
def test_how_a_process_ended_is_said_in_one_line(run, ended: Ended, said: str) -> None:
    write_status(run, dataclasses.replace(STATUS, pid=DEAD_PID))
    state = judge(run, ended)
    assert state.phase == "failed" and said in state.message and "\n" not in state.message


PAPER = CurriculumConfig()


def test_a_training_of_two_stages_tells_what_the_second_one_kept(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    config = small_run(speeds_mps=(4.0, 5.0), episodes=(30, 10))
    curriculum = dataclasses.replace(config.curriculum, replay="threshold", keep_reward=1.0)
    train_here(workspace.run_path("two"), dataclasses.replace(config, curriculum=curriculum))
    details = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest("two", None)).details
    assert details is not None and len(details.stage_starts) == 1
    (start,) = details.stage_starts
    assert start["episode"] == 30
    lines = read_lines(seed_files(workspace.run_path("two"), 0).metrics)[0]
    good = [float(str(line["reward"])) >= 1.0 - 1e-6 for line in lines[:30]]
    assert start["kept"] == sum(good) > 0 and start["dropped"] == 30 - sum(good) > 0
    text = kept_html(details.stage_starts, curriculum)
    assert f"stage 2, 5 m/s: {sum(good)} of 30 kept" in text
    for case in Case:
        of_case = [kept for kept, line in zip(good, lines[:30], strict=True) if line["case"] == case]
        words = f"{CASE_NAMES[case]} {sum(of_case)} of {len(of_case)}<"
        assert (words in text) == bool(of_case)


def test_a_bar_is_as_long_as_its_share_and_dropped_balls_are_faded() -> None:
    line: dict[str, object] = {"stage": 1, "speed_mps": 5.0, "kept": 75, "dropped": 25}
    text = kept_html((line | {"kept_cases": {"4": [75, 0], "2": [0, 25]}},), PAPER)
    assert "width:74.25%" in text and "width:24.75%" in text and text.count("opacity:0.28") == 1
    assert f"{CASE_NAMES[Case.RETURNED]} 75 of 75" in text and f"{CASE_NAMES[Case.NET]} 0 of 25" in text
    older = kept_html((line,), PAPER)  # a run of an earlier version
    assert "75 of 100 kept" in older and "width" not in older


def test_nothing_is_shown_of_one_stage_or_of_damaged_lines() -> None:
    assert kept_html((), PAPER) == ""
    damaged: tuple[dict[str, object], ...] = (
        {"kept": "x"},
        {"kept": 0, "dropped": 0, "stage": 0, "speed_mps": 5.0},
        {"kept": 3, "stage": "<b>"},
    )
    for line in damaged:
        assert kept_html((line,), PAPER) == ""
    odd: dict[str, object] = {
        "stage": 1,
        "speed_mps": 5.0,
        "kept": 1,
        "dropped": 1,
        "kept_cases": {"9": [1, 1], "4": "<img>"},
    }
    assert "img" not in kept_html((odd,), PAPER)


def test_the_rule_is_said_in_words() -> None:
    assert "at least 1" in rule_text(PAPER)
    assert rule_text(CurriculumConfig(replay="retain")) == "retain: all"
    assert rule_text(CurriculumConfig(replay="discard")) == "discard: none"
