"""What is measured (methods on the recordings of `paper7`, made once for each seed), and what is kept of each
measurement, as JSON: an interrupted bench goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from core.chain.config import ChainConfig, chain_for_physics, published_chain
from core.config import config_to_mapping
from core.data_sets import DataSetPlan, preset_plan
from core.data_sets.plan import PAPER7_FRAMES, Making
from core.detection.methods import Method
from core.files import read_json, write_json
from core.physics.config import physics_profile

METHODS: Final[tuple[Method, ...]] = ("paper", "auto", "refined", "ebpp", "fe-fusion")
FRAME_METHODS: Final = ("yolo",)
"""Those that look at the pictures of the same recordings."""
ROWS: Final = (*METHODS, *FRAME_METHODS)
RIVALS: Final[tuple[Method, ...]] = ("ebpp", "fe-fusion")
FIRST_SEED: Final = 7
BALL_ONLY: Final = "ball"
"""The scene of the recordings without people."""


def seed_plan(seed: int) -> DataSetPlan:
    """The seven recordings of a seed, as `rallyscope simulate --preset paper7` makes them."""
    return preset_plan("paper7", seed, Making(frames=PAPER7_FRAMES))


def set_folder(folder: Path, seed: int) -> Path:
    """Where the recordings of a seed are."""
    return folder / f"paper7-{seed}"


def chain_of(method: Method) -> ChainConfig:
    """The chain from a method's detections to the hitting point: `paper` predicts as published too.

    It is told the physics of the recordings: methods that find the ball are compared, not what a filter finds out.
    """
    if method == "paper":
        return published_chain()
    return chain_for_physics(ChainConfig.of_method(method), physics_profile(Making(frames=PAPER7_FRAMES).physics))


def result_path(folder: Path, seed: int, recording: str, method: Method) -> Path:
    """Path of one method's result on one recording; its settings are part of the name."""
    settings = json.dumps(config_to_mapping(chain_of(method)), sort_keys=True, default=str)
    stamp = hashlib.sha256(settings.encode()).hexdigest()[:10]
    return folder / "results" / str(seed) / f"{recording}-{method}-{stamp}.json"


def frame_result_path(folder: Path, seed: int, recording: str, method: str, stamp: str) -> Path:
    """Result path of a frame-based method; the stamp identifies its weights."""
    return folder / "results" / str(seed) / f"{recording}-{method}-{stamp}.json"


def reading_path(folder: Path, seed: int, recording: str) -> Path:
    """Path of what does not depend on the method: frames, and the read time per event."""
    return folder / "results" / str(seed) / f"{recording}.json"


DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownAnswer:
    """What a method said of the window that is drawn."""

    t_us: int
    u_px: float
    v_px: float
    r_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceptionResult:
    """What one method did on one recording, all its cameras together."""

    scene: str
    seed: int
    recording: str
    method: str
    window_us: int
    windows: int
    asked: int
    """Times of the 1 ms grid at which a ball was to be found; this and the next three as in `GridScore`."""
    found: int
    answers: int
    false: int
    error_px: tuple[float, ...]
    """Of the right answers, at the times that they state less `delay_us`."""
    events: int
    """Read by the detectors: all of all windows."""
    cpu_ms: tuple[float, ...]
    """Processor time of the steps that answered."""
    recovery_ms: tuple[float | None, ...]
    """From a ball's appearance to the first right answer; None where it went away without."""
    bound_px: tuple[float, ...]
    """Least median error of a circle through the events seen, at times 10 ms apart: `CircleBounds.events_px`."""
    pixel_bound_px: tuple[float, ...]
    """And `CircleBounds.pixels_px`."""
    point_mm: tuple[float, ...]
    """Distance of the points in space from the ball."""
    points_without_ball: int
    hits: int
    """Balls that came to the hitting plane."""
    hit_mm: tuple[float, ...]
    """Errors of the hitting points that were predicted 100 ms before."""
    shown: ShownAnswer | None
    """In the first camera, of the window that is drawn; None where it said nothing."""
    frame_bytes: int = 0
    """Of the pictures that were read, not compressed; so the next two, 0 and None of methods that look at events."""
    exposure_us: int = 0
    sharp_recall: float | None = None
    """What the detector finds of sharp pictures that it was not trained on: with less than 0.9 it is no rival."""
    delay_us: tuple[int, ...] = ()
    """Of each camera, the one delay that was taken out of all answers before errors were compared."""
    age_ms: tuple[float, ...] = ()
    """Of the newest answer with a ball that has arrived, at the times with a ball, as this machine computes; so the
    next two."""
    held_px: tuple[float, ...] = ()
    """Its distance from the ball if it stays where it was."""
    moved_px: tuple[float, ...] = ()
    """And if it is moved on by the ball's velocity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingReading:
    """What holds for a recording whatever the method."""

    scene: str
    seed: int
    recording: str
    seconds: float
    """Of all cameras together."""
    events: int
    frames: int
    frames_with_ball: int
    """Frames at whose mid exposure the ball can be seen."""
    frame_bytes: int
    """Of one frame, not compressed; 0 without frames."""
    frame_period_us: int
    exposure_us: int
    read_ns: float
    """Processor time of reading one event once."""
    shown_us: int | None
    """End of the window that is drawn; None where no ball is ever wholly in view."""


def rounded(values: Sequence[float] | np.ndarray) -> tuple[float, ...]:
    """Values rounded for the result file."""
    return tuple(round(float(value), DIGITS) for value in values)


def keep(path: Path, result: PerceptionResult | RecordingReading) -> None:
    """Write a result in one step."""
    write_json(path, asdict(result))


def kept_result(path: Path) -> PerceptionResult | None:
    """A result that was kept; None if there is none, or one of another version."""
    stored: dict[str, Any] = read_json(path)
    if not stored:
        return None
    stored = {"frame_bytes": 0, "exposure_us": 0, "sharp_recall": None} | stored  # kept before there were pictures
    if stored.keys() != {field.name for field in fields(PerceptionResult)}:
        return None
    shown = stored.pop("shown")
    columns: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()
    }
    return PerceptionResult(**columns, shown=None if shown is None else ShownAnswer(**shown))


def kept_reading(path: Path) -> RecordingReading | None:
    """The stored reading that holds for every method, or None."""
    stored: dict[str, Any] = read_json(path)
    if stored.keys() != {field.name for field in fields(RecordingReading)}:
        return None
    return RecordingReading(**stored)


def median_with_lost(values: Sequence[float | None]) -> float:
    """The median of times, those that never came counted as endless; nan of none."""
    ordered = sorted(math.inf if value is None else value for value in values)
    if not ordered:
        return math.nan
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return low if low == high else (low + high) / 2
