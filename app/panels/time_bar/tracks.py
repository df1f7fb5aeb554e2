"""What the time line shows of a recording, as plain values; knows no browser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.panels.recording_info import RecordingInfo
from core.metrics import WindowVerdicts
from core.recordings import Recording
from core.recordings.truth import first_seen_us, turning_points

MOST: Final = 2_000
"""Of moments or stretches of one kind that are sent; there are no more pixels to show them in."""
AFTER_FIRST_US: Final = 20_000
"""By then the first ball is wholly in the picture."""
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Stretches of time with one meaning each: (N,) starts, ends and kinds; ends are exclusive."""

    start_us: Times
    end_us: Times
    kinds: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The lines of the time line, top to bottom."""

    duration_us: int
    rates: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """By camera: events a second in bins of equal length from 0 to the end."""
    moments: Mapping[str, Times] = field(default_factory=dict)
    """By kind ("bounce", "hit"): when it happens."""
    runs: Mapping[str, Runs] = field(default_factory=dict)
    """By name of the line ("labels", "detector"): what holds when."""


def tracks_of(recording: Recording, info: RecordingInfo | None) -> Tracks:
    """What a recording knows by itself. Its rates come from `info`."""
    rates = {} if info is None else {name: curve.rate_hz for name, curve in info.curves.items()}
    return Tracks(recording.duration_us, rates, moments_of(recording))


def moments_of(recording: Recording) -> dict[str, Times]:
    """Its bounces and hits so far, where it knows the truth; those of a live recording change as it goes on."""
    if recording.ball is None:
        return {}
    points = turning_points(recording.ball)
    return {"bounce": points.bounces_us, "hit": points.hits_us}


def same_moments(first: Mapping[str, Times], second: Mapping[str, Times]) -> bool:
    """Whether both tell of the same happenings."""
    return first.keys() == second.keys() and all(np.array_equal(first[kind], second[kind]) for kind in first)


def opening_us(recording: Recording) -> int:
    """Where a recording opens: at its first ball, where that is known; else at its start."""
    seen_us = first_seen_us(stream.truth for stream in recording.cameras.values())
    return 0 if seen_us is None else min(seen_us + AFTER_FIRST_US, recording.duration_us)


def runs_of_times(t_us: Times, kinds: NDArray[np.int64], names: tuple[str, ...], width_us: int) -> Runs:
    """Times (ascending) with a kind each, joined where neighbours of one kind are no further apart than `width_us`.

    Each time stands for the `width_us` that begin with it.
    """
    if not len(t_us):
        return Runs(t_us, t_us, ())
    new = np.ones(len(t_us), np.bool_)
    new[1:] = (np.diff(t_us) > width_us) | (kinds[1:] != kinds[:-1])
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(t_us)) - 1
    return Runs(t_us[starts], t_us[ends] + width_us, tuple(names[kind] for kind in kinds[starts]))


def runs_of_verdicts(verdicts: WindowVerdicts, window_us: int) -> Runs:
    """Where a detector found the ball, missed it, or saw one that was not there."""
    kinds = np.select([verdicts.false, verdicts.missed, verdicts.found], [2, 1, 0], default=-1)
    told = kinds >= 0
    return runs_of_times(verdicts.t_us[told] - window_us // 2, kinds[told], ("found", "missed", "false"), window_us)


def thinned(count: int) -> slice:
    """Every so many of `count` rows, so that at most `MOST` are left."""
    return slice(None, None, max(1, -(-count // MOST)))
