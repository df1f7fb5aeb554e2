"""Runs on disk, made by the real training code, and a trainer whose process is always ended."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.shared.trainer import RunState, Trainer
from app.shared.workspace import Workspace
from core.learning.config import RunConfig
from core.learning.runs.run_files import create_run
from tests.app.modes.train.small_runs import small_run
from tests.waiting import eventually


def train_here(run: Path, config: RunConfig) -> None:
    """Train in this process."""
    from core.learning.runs.running import run_training

    create_run(run, config)
    assert run_training(run, progress=lambda share: None, stopped=lambda: False) == "finished"


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A workspace with a finished run, `small`: 40 balls at 5 m/s, two seeds. Do not write to it."""
    workspace = Workspace(tmp_path_factory.mktemp("trained"))
    train_here(workspace.run_path("small"), small_run(episodes=(40,), seeds=2))
    return workspace


@pytest.fixture
def trainer(tmp_path: Path) -> Iterator[Trainer]:
    """Of an empty workspace."""
    trainer = Trainer(Workspace(tmp_path / "workspace"))
    yield trainer
    trainer.ask("stop")
    eventually(lambda: trainer.active() is None, "the training to end")


@pytest.fixture
def state_of() -> Callable[[Trainer, str], RunState]:
    """The state of a run by its name."""

    def find(trainer: Trainer, name: str) -> RunState:
        (state,) = [state for state in trainer.runs() if state.name == name]
        return state

    return find
