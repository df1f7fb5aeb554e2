"""The source `replay:FILE[@SPEED]` of the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from app.cli.progress import progress_bar
from core.errors import CommandError

if TYPE_CHECKING:
    from core.live.replay_source import ReplaySource
    from core.physics.config import PhysicsConfig

REPLAY: Final = "replay:"
FORM: Final = "replay:FILE[@SPEED], for example replay:pair.h5@0.5"


@dataclass(frozen=True, slots=True)
class ReplayOrder:
    """A file, and how many of its seconds pass in one."""

    path: Path
    speed: float


def read_replay(source: str) -> ReplayOrder | None:
    """What is to be replayed; None for a source of another kind. What follows the last @ is the speed.

    Raises:
        CommandError: if there is no such file, or the speed is no number.
    """
    if not source.startswith(REPLAY):
        return None
    file_and_speed = source.removeprefix(REPLAY)
    file, at, speed = file_and_speed.rpartition("@")
    if not at or Path(file_and_speed).is_file():  # there are names with an @ in them
        file, speed = file_and_speed, "1"
    if not file:
        raise CommandError("no file to replay", expected=FORM, got=repr(source), where="--source")
    if not Path(file).is_file():
        raise CommandError("no such file to replay", expected=FORM, got=file, where="--source")
    factor = _number(speed)
    if factor is None:
        raise CommandError("not a speed of a replay", expected=FORM, got=repr(speed), where="--source")
    return ReplayOrder(Path(file), factor)


def open_replay(order: ReplayOrder, *, loop: bool = True, physics: PhysicsConfig | None = None) -> ReplaySource:
    """The source, which stands still until somebody listens. A file of another format is decoded first.

    With `loop` it goes round for ever. `physics`: of the rally, if known.

    Raises:
        ConfigError: if the speed is out of bounds.
        RecordingError: if it is no recording, or one without cameras or events.
    """
    from core.live.replay_source import ReplaySource, check_speed
    from core.recordings import open_recording

    check_speed(order.speed)  # before a file is decoded
    with progress_bar(f"Opening {order.path.name}") as progress:
        recording = open_recording(order.path, progress=progress)
        progress(1.0)
    try:
        return ReplaySource(recording, order.path.name, speed=order.speed, loop=loop, physics=physics)
    except BaseException:
        recording.close()
        raise


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
