"""The two small files through which a training process and the one who watches it talk: status and control."""

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
    """What a person wants a training process to do."""

    command: RunCommand = "run"
    episodes_per_s: float | None = None
    """Slow down to this many, to watch; None: as fast as it goes."""


@dataclass(frozen=True, slots=True)
class RunStatus:
    """How a training process is doing."""

    state: State
    pid: int
    seed: int
    episode: int
    """Done in this seed."""
    episodes: int
    """Most episodes of one seed."""
    share: float
    """Share of the whole run, all seeds, that is done, 0..1."""
    speed_mps: float
    seconds_left: float | None
    message: str = ""


def hold_run(run: Path) -> AbstractContextManager[object]:
    """Be the only process that trains this run.

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
    """Ask the process that trains this run to go on, pause, stop or slow down; it looks before every episode."""
    write_json(run / "control.json", {"wish": control.command, "episodes_per_s": control.episodes_per_s})


def read_control(run: Path) -> Control:
    """What is asked for; to go on if nothing is, or nothing that makes sense."""
    found = read_json(run / "control.json")
    command, rate = found.get("wish"), found.get("episodes_per_s")
    wanted: RunCommand = "pause" if command == "pause" else "stop" if command == "stop" else "run"
    return Control(wanted, float(rate) if isinstance(rate, (int, float)) and 0 < rate < 1e9 else None)


def write_status(run: Path, status: RunStatus) -> None:
    """Tell how it goes."""
    write_json(run / "status.json", dataclasses.asdict(status))


def read_status(run: Path) -> RunStatus | None:
    """How it goes, or went; None before a first word. A process that died is `failed`, whatever it last said."""
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
