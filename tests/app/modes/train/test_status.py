"""What is said about a run."""

import dataclasses

import pytest

from app.modes.train.status import ball_html, log_html, plan_text, runs_html, status_html, time_text
from app.shared.training.run_state import Ended, RunState, judge_run
from core.learning.runs.control import RunStatus, hold_run, write_status
from core.learning.runs.run_files import create_run
from tests.app.modes.train.small_runs import small_run

CONFIG = small_run(speeds_mps=(3.0, 5.0), episodes=(10, 20), seeds=2)
STATUS = RunStatus("running", 1, 0, 5, 30, 0.2, 3.0, 100.0)
STATE = RunState("mine", CONFIG, "running", STATUS, None, 0.0)
DEAD_PID = 2**22 + 1
"""Larger than any process number."""


def test_before_the_first_training_a_newcomer_is_told_what_to_do() -> None:
    assert "Train now" in status_html(None, None, None)
    assert "no ball" in ball_html(None)


def test_a_plan_is_said_in_one_line() -> None:
    assert plan_text(STATE) == "landing-model, cdta reward, 10 at 3 m/s, 20 at 5 m/s, 2 seeds"


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
