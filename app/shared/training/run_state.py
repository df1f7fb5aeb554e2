"""How a run is doing, from its files and from what is known of its process."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from core.learning.config import RunConfig
from core.learning.runs.control import RunStatus, is_held, read_control, read_status

RunPhase = Literal["new", "starting", "running", "paused", "stopping", "ending", "stopped", "finished", "failed"]
ACTIVE: Final[tuple[RunPhase, ...]] = ("starting", "running", "paused", "stopping", "ending")
UNEXPECTED: Final = "the process ended unexpectedly"
LOG_NAME: Final = "train.log"
LOG_TAIL_BYTES: Final = 16_384
LOG_LINES: Final = 12
LOG_LINE_CHARACTERS: Final = 240


@dataclass(frozen=True, slots=True)
class RunState:
    """One run as the app sees it."""

    name: str
    config: RunConfig
    phase: RunPhase
    status: RunStatus | None
    episodes_per_s: float | None
    """How fast it may go; None: as fast as it can."""
    changed_s: float
    """When its files were last written, seconds since the epoch."""
    message: str = ""
    """What went wrong, in one line."""

    @property
    def active(self) -> bool:
        """A process trains it."""
        return self.phase in ACTIVE

    @property
    def resumable(self) -> bool:
        """It ended, or never began, before all was done."""
        return self.phase in ("new", "stopped", "failed")


@dataclass(frozen=True, slots=True)
class Ended:
    """A process that this app started and that is over."""

    returncode: int
    log_tail: tuple[str, ...]


def judge_run(
    run: Path, config: RunConfig, *, child_lives: bool, child_pid: int | None, stopping: bool, ended: Ended | None
) -> RunState:
    """The state of a run: `child_*` and `ended` are of a process that this app started for it, if it did."""
    status = read_status(run)
    message = ""
    phase: RunPhase
    if child_lives and (status is None or status.pid != child_pid):
        phase = "stopping" if stopping else "starting"
    elif status is not None and status.state in ("running", "paused") and (child_lives or is_held(run)):
        phase = "stopping" if stopping else status.state
    elif child_lives:
        phase = "ending"  # its last word is said
    elif ended is not None and ended.returncode != 0:
        phase, message = "failed", _why(status, ended)
    elif status is None:
        phase = "new"
    elif status.state in ("running", "paused", "failed"):
        phase = "failed"
        message = status.message or UNEXPECTED
    else:
        phase = status.state
    return RunState(run.name, config, phase, status, read_control(run).episodes_per_s, _changed_s(run), message)


def _why(status: RunStatus | None, ended: Ended) -> str:
    if ended.returncode < 0:
        try:
            name = signal.Signals(-ended.returncode).name
        except ValueError:
            name = f"signal {-ended.returncode}"
        return f"the process was killed ({name})"
    for line in reversed(ended.log_tail):
        if line.startswith("rallyscope: ") and "this is a bug" not in line:
            return line.removeprefix("rallyscope: ")
    said = status.message if status is not None and status.state == "failed" else ""
    return f"{said or UNEXPECTED} (exit code {ended.returncode})"


def _changed_s(run: Path) -> float:
    for name in ("status.json", "config.toml"):
        try:
            return (run / name).stat().st_mtime
        except OSError:
            continue
    return 0.0


def read_log_tail(run: Path) -> tuple[str, ...]:
    """The last lines of a run's log; none if there is none."""
    try:
        with (run / LOG_NAME).open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - LOG_TAIL_BYTES))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return ()
    lines = [line.rstrip()[:LOG_LINE_CHARACTERS] for line in text.replace("\r", "\n").splitlines()]
    return tuple(line for line in lines if line)[-LOG_LINES:]
