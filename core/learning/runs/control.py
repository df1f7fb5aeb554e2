"""Status and control files, through which a training process and its observer communicate."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

from core import files
from core.errors import ConfigError
from core.files import read_json, write_json

RunCommand = Literal["run", "pause", "stop"]
State = Literal["running", "paused", "stopped", "finished", "failed"]


@dataclass(frozen=True, slots=True)
class Control:
    """Command to a training process."""

    command: RunCommand = "run"
    episodes_per_s: float | None = None
    """Speed limit, episodes/s; None: unlimited."""


@dataclass(frozen=True, slots=True)
class RunStatus:
    """Status of a training process."""

    state: State
    pid: int
    seed: int
    episode: int
    """Episodes done in this seed."""
    episodes: int
    """Most episodes of one seed."""
    share: float
    """Share of the whole run, all seeds, that is done, 0..1."""
    speed_mps: float
    seconds_left: float | None
    message: str = ""


def hold_run(run: Path) -> AbstractContextManager[object]:
    """Lock the run for this process.

    Raises:
        ConfigError: if another one does.
    """
    try:
        return files.hold(run / ".lock")
    except TimeoutError as error:
        raise ConfigError("another process is training this run", where=run) from error
    except OSError as error:
        remedy = "make its folder writable, or train a copy of it"
        raise ConfigError("the run cannot be written", got=error.strerror, where=run, remedy=remedy) from error


def is_held(run: Path) -> bool:
    """Whether a process trains this run now; a number of a process alone may be another's after a restart."""
    return files.is_held(run / ".lock")


def write_control(run: Path, control: Control) -> None:
    """Command the training process to continue, pause, stop or slow down; it checks before every episode."""
    write_json(run / "control.json", {"wish": control.command, "episodes_per_s": control.episodes_per_s})


def read_control(run: Path) -> Control:
    """Current command; continue if there is none, or an invalid one."""
    found = read_json(run / "control.json")
    command, rate = found.get("wish"), found.get("episodes_per_s")
    wanted: RunCommand = "pause" if command == "pause" else "stop" if command == "stop" else "run"
    return Control(wanted, float(rate) if isinstance(rate, (int, float)) and 0 < rate < 1e9 else None)


def write_status(run: Path, status: RunStatus) -> None:
    """Write the status."""
    write_json(run / "status.json", dataclasses.asdict(status))


def read_status(run: Path) -> RunStatus | None:
    """Status of a run; None before the first. A process that died is `failed`, whatever its last status."""
    found = read_json(run / "status.json")
    if not _is_status(found):
        return None
    status = RunStatus(**found)  # type: ignore[arg-type]
    alive = _is_alive(status.pid) if files.POSIX else is_held(run)  # to ask for a process may end it on Windows
    if status.state in ("running", "paused") and not alive:
        return dataclasses.replace(status, state="failed", message=status.message or "the process ended unexpectedly")
    return status


def _is_status(found: Mapping[str, object]) -> bool:
    """Whether every value is there and of its kind: the file may be damaged."""
    whole, real = ("pid", "seed", "episode", "episodes"), ("share", "speed_mps", "seconds_left")
    names = {field.name for field in dataclasses.fields(RunStatus)}
    return (
        names - {"message"} <= found.keys() <= names
        and found["state"] in get_args(State)
        and all(type(found[name]) is int and 0 <= cast(int, found[name]) < 2**31 for name in whole)
        and all(type(found[name]) in (int, float) or (name == "seconds_left" and found[name] is None) for name in real)
        and isinstance(found.get("message", ""), str)
    )


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
