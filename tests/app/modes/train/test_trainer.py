"""The training process, for real: started, paused, stopped, killed, found again."""

import os
import signal

import pytest

from app.shared.trainer import LOG_NAME, Trainer, read_log_tail
from app.shared.training_records import MetricsReader
from app.shared.workspace import Workspace
from core.errors import RallyscopeError
from core.learning.runs.run_files import read_lines, seed_files
from tests.app.modes.train.small_runs import small_run
from tests.waiting import eventually

SLOW = 20.0
PLAN = small_run(episodes=(60,))


def test_a_run_goes_to_its_end_at_the_pace_that_is_asked_for(trainer: Trainer, state_of) -> None:
    assert trainer.start("One Run", PLAN, 2.0) == "one-run"
    assert state_of(trainer, "one-run").phase == "starting"
    with pytest.raises(RallyscopeError, match="one training at a time"):
        trainer.start("another", PLAN, None)
    with pytest.raises(RallyscopeError, match="one training at a time"):
        trainer.resume("one-run")
    eventually(lambda: state_of(trainer, "one-run").phase == "running", "it to run")
    trainer.ask("pause")
    eventually(lambda: state_of(trainer, "one-run").phase == "paused", "it to pause")
    trainer.set_pace(None)
    trainer.ask("run")
    eventually(lambda: state_of(trainer, "one-run").phase == "finished", "it to finish")
    state = state_of(trainer, "one-run")
    assert state.status is not None and state.status.share == 1.0 and not state.resumable
    assert read_log_tail(trainer._workspace.run_path("one-run"))[0].endswith("started")
    with pytest.raises(RallyscopeError, match="finished"):
        trainer.resume("one-run")
    with pytest.raises(RallyscopeError, match="already"):
        trainer.start("one-run", PLAN, None)


def test_a_killed_training_is_reported_and_goes_on_to_the_same_end(
    trainer: Trainer, trained: Workspace, state_of
) -> None:
    config = small_run(episodes=(40,))
    trainer.start("killed", config, 5.0)  # two checkpoints are far from its end
    run = trainer._workspace.run_path("killed")
    reader = MetricsReader(run, 0)
    eventually(lambda: len(reader.read().evaluations) >= 2, "two checkpoints")
    state = state_of(trainer, "killed")
    assert state.status is not None
    os.kill(state.status.pid, signal.SIGKILL)
    eventually(lambda: state_of(trainer, "killed").phase == "failed", "the end to be noticed")
    assert "SIGKILL" in state_of(trainer, "killed").message
    trainer.resume("killed")
    trainer.set_pace(None)
    eventually(lambda: state_of(trainer, "killed").phase == "finished", "it to finish")
    whole = read_lines(seed_files(trained.run_path("small"), 0).metrics)[0]
    assert read_lines(seed_files(run, 0).metrics)[0] == whole


def test_another_app_finds_the_training_and_can_stop_it(trainer: Trainer, state_of) -> None:
    trainer.start("found", small_run(episodes=(2000,)), SLOW)
    other = Trainer(trainer._workspace)
    with pytest.raises(RallyscopeError, match="one training at a time"):
        other.start("second", PLAN, None)  # at once: the first one's process has not begun
    assert "second" not in other._workspace.run_names()
    eventually(lambda: state_of(trainer, "found").phase == "running", "it to run")
    active = other.active()
    assert active is not None and active.name == "found" and active.phase == "running"
    with pytest.raises(RallyscopeError, match="one training at a time"):
        other.start("second", PLAN, None)
    other.ask("stop")
    eventually(lambda: state_of(other, "found").phase == "stopped", "it to stop")
    assert state_of(other, "found").resumable
    eventually(lambda: state_of(trainer, "found").phase == "stopped", "the first app to notice")


@pytest.mark.gate
def test_a_stop_while_the_process_is_only_starting_is_not_lost(trainer: Trainer, state_of) -> None:
    trainer.start("early", small_run(episodes=(2000,)), SLOW)
    trainer.ask("stop")
    assert state_of(trainer, "early").phase == "stopping"
    eventually(lambda: not state_of(trainer, "early").active, "it to stop")
    assert state_of(trainer, "early").phase == "stopped"


def test_a_training_that_cannot_go_on_says_why(trainer: Trainer, state_of) -> None:
    workspace = trainer._workspace
    from core.learning.runs.run_files import create_run

    run = workspace.run_path("broken")
    create_run(run, PLAN)
    seed_files(run, 0).folder.mkdir()
    seed_files(run, 0).checkpoint.write_bytes(b"nothing of ours")
    trainer.resume("broken")
    eventually(lambda: state_of(trainer, "broken").phase == "failed", "it to fail")
    message = state_of(trainer, "broken").message
    assert "not a checkpoint" in message and "\n" not in message
    assert any("not a checkpoint" in line for line in read_log_tail(run))


def test_names_come_from_the_server_or_become_slugs(trainer: Trainer) -> None:
    workspace = trainer._workspace
    with trainer.free_name("first") as name, trainer.free_name("first") as other:
        assert (name, other) == ("first-1", "first-2")
    (workspace.runs / "first-1").mkdir()
    (workspace.runs / "first-1" / "config.toml").write_text("colour = 1")
    with trainer.free_name("first") as name:
        assert name == "first-2"
    for name in ("../../etc", "no-such-run"):
        with pytest.raises(RallyscopeError, match="no such run"):
            trainer.resume(name)
    with pytest.raises(RallyscopeError):
        trainer.start("///", PLAN, None)
    assert trainer.runs() == ()  # what cannot be read is no run


def test_a_long_log_is_shown_by_its_end(tmp_path) -> None:
    (tmp_path / LOG_NAME).write_bytes(b"x" * 100_000 + b"\n" + b"\xff last\rline " + b"y" * 1000)
    tail = read_log_tail(tmp_path)
    assert tail[-2].endswith("last") and tail[-1].startswith("line ") and all(len(line) <= 240 for line in tail)
    assert read_log_tail(tmp_path / "nowhere") == ()
