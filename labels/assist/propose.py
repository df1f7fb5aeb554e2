"""Proposals: what the detector finds, moved to the circle that fits the events, for a person to accept or reject."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import config_to_mapping
from core.detection import Detection, DetectorConfig, RefinedDetection, make_detector
from core.detection.methods import DEFAULT_METHOD, Method, method_config
from core.detection.window import windows_between
from core.recordings import CameraStream
from labels.assist.snap import SnapConfig, snap
from labels.model import Label, LabelState, PositionSource, Provenance

Array = NDArray[np.float64]
SIDE = 4
"""Neighbours on either side that have a say."""
LEAST = 3
"""Neighbours on one side that say where a ball comes from, or goes to."""


def residual_of_neighbours(t_us: NDArray[np.int64], x_px: Array, y_px: Array, *, max_gap_us: int) -> Array:
    """(N,) pixels from the median of what parabolas through triples of neighbours predict; nan with too few of them.

    A median of many predictions holds while less than about a third of the neighbours are wrong.

    Args:
        t_us: (N,) times, ascending.
        x_px: (N,) columns.
        y_px: (N,) rows.
        max_gap_us: a neighbour farther away does not count.
    """
    count = len(t_us)
    places = np.column_stack([x_px, y_px])
    neighbours = np.arange(count)[:, None] + [k for k in range(-SIDE, SIDE + 1) if k]
    inside = (neighbours >= 0) & (neighbours < count)
    neighbours = np.clip(neighbours, 0, max(count - 1, 0))
    since = (t_us[neighbours] - t_us[:, None]).astype(np.float64) if count else np.empty((0, 2 * SIDE))
    inside &= np.abs(since) <= max_gap_us * SIDE
    predictions = []
    for triple in combinations(range(2 * SIDE), 3):
        use = list(triple)
        t, p = since[:, use], places[neighbours[:, use]]
        fine = inside[:, use].all(axis=1)
        # Lagrange's parabola at time 0.
        weights = [
            (t[:, j] * t[:, k]) / np.where(fine, (t[:, i] - t[:, j]) * (t[:, i] - t[:, k]), 1.0)
            for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
        ]
        # One that extrapolates far says little: leave it out.
        steady = np.sum(np.abs(weights), axis=0) < 4.0
        value = sum(weight[:, None] * p[:, i] for i, weight in enumerate(weights))
        predictions.append(np.where((fine & steady)[:, None], value, np.nan))
    stack = np.array(predictions)
    enough = np.isfinite(stack[:, :, 0]).sum(axis=0) >= 2
    middle = np.full((count, 2), np.nan)
    if enough.any():
        middle[enough] = np.nanmedian(stack[:, enough], axis=0)
    return np.linalg.norm(places - middle, axis=1)


def residual_of_one_side(t_us: NDArray[np.int64], x_px: Array, y_px: Array, row: int, *, max_gap_us: int) -> float:
    """Distance of a position from the path before it or that behind it, whichever is nearer, px; nan without either.

    At a bounce or a hit a position fits one of them; one that is wrong fits neither.

    Args:
        t_us: (N,) times, ascending.
        x_px: (N,) columns.
        y_px: (N,) rows.
        row: which position.
        max_gap_us: largest mean distance of neighbours.
    """
    places, found = np.column_stack([x_px, y_px]), [float("nan")]
    for rows in (np.arange(max(row - SIDE, 0), row), np.arange(row + 1, min(row + 1 + SIDE, len(t_us)))):
        rows = rows[np.abs(t_us[rows] - t_us[row]) <= max_gap_us * SIDE]
        if len(rows) < LEAST:
            continue
        since_ms = (t_us[rows] - t_us[row]) * 1e-3
        at = [np.polyfit(since_ms, places[rows, axis], 2 if len(rows) > LEAST else 1)[-1] for axis in (0, 1)]
        found.append(float(np.hypot(*(places[row] - at))))
    return float(np.nanmin(found)) if len(found) > 1 else float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """N positions, times ascending."""

    t_us: NDArray[np.int64]
    x_px: Array
    y_px: Array
    r_px: Array
    covariance_px2: Array
    """(N, 3) xx, xy, yy; nan where no circle fitted and the detector's own position stands."""
    window_us: int
    detector: str
    """Method and hash of the settings, as it is noted in labels."""

    def __len__(self) -> int:
        return len(self.t_us)

    def between(self, start_us: int, end_us: int) -> Proposals:
        """Proposals with `start_us <= t < end_us`."""
        first, last = np.searchsorted(self.t_us, (start_us, end_us))
        return self.rows(slice(int(first), max(int(first), int(last))))

    def rows(self, rows: NDArray[np.bool_] | slice) -> Proposals:
        """A subset in the same order."""
        columns = (self.x_px[rows], self.y_px[rows], self.r_px[rows], self.covariance_px2[rows])
        return Proposals(self.t_us[rows], *columns, self.window_us, self.detector)

    def at(self, t_us: ArrayLike) -> Proposals:
        """At other times: interpolated between two that are at most two windows apart, else nan."""
        t = np.atleast_1d(np.asarray(t_us, np.int64))
        if not len(self):
            nothing = np.full(len(t), np.nan)
            return Proposals(t, nothing, nothing, nothing, np.full((len(t), 3), np.nan), self.window_us, self.detector)
        after = np.clip(np.searchsorted(self.t_us, t), 0, len(self) - 1)
        before = np.where(self.t_us[after] == t, after, np.maximum(after - 1, 0))
        span = self.t_us[after] - self.t_us[before]
        inside = (self.t_us[before] <= t) & (t <= self.t_us[after]) & (span <= 2 * self.window_us)
        share = np.where(span > 0, (t - self.t_us[before]) / np.maximum(span, 1), 0.0)
        columns = np.column_stack([self.x_px, self.y_px, self.r_px, self.covariance_px2])
        mixed = columns[before] * (1 - share)[:, None] + columns[after] * share[:, None]
        mixed[~inside] = np.nan
        return Proposals(t, mixed[:, 0], mixed[:, 1], mixed[:, 2], mixed[:, 3:], self.window_us, self.detector)


def propose(
    stream: CameraStream,
    start_us: int,
    end_us: int,
    *,
    method: Method = DEFAULT_METHOD,
    config: DetectorConfig | None = None,
    snap_config: SnapConfig | None = None,
    progress: Callable[[float], None] | None = None,
) -> Proposals:
    """What the detector finds in [start_us, end_us), snapped; of a ball whose motion is known at the windows' ends.

    Args:
        stream: the camera.
        start_us: begin of the search.
        end_us: its end.
        method: name of the detector.
        config: its settings.
        snap_config: how a detection is fitted to the events.
        progress: gets the share that is done.
    """
    config, snap_config = method_config(method, config), snap_config or SnapConfig()
    window_us = config.window.window_us
    detector = make_detector(method, stream.sensor, config)
    rows: list[tuple[float, ...]] = []
    times: list[int] = []
    previous: tuple[float, float] | None = None
    for window in windows_between(stream, start_us, end_us, window_us):
        found = detector.step(window)
        if progress is not None:
            progress((window.end_us - start_us) / max(end_us - start_us, 1))
        if found is None:
            previous = None
            continue
        found = _at(window.end_us, found)
        # A millisecond more than it looks at: an event just outside tells that a pixel's first one is not its first.
        reach = snap_config.reach_us + 1000
        near = stream.slice(max(found.t_us - reach, 0), found.t_us + reach)
        fitted = snap(near, found.t_us, found.u_px, found.v_px, v_px_per_ms=previous, config=snap_config)
        times.append(found.t_us)
        if fitted is None:
            rows.append((found.u_px, found.v_px, found.r_px, np.nan, np.nan, np.nan))
            previous = None
        else:
            rows.append((fitted.x_px, fitted.y_px, fitted.r_px, *fitted.covariance_px2))
            previous = (fitted.vx_px_per_ms, fitted.vy_px_per_ms)
    table = np.array(rows, np.float64).reshape(-1, 6)
    x, y, r = (np.ascontiguousarray(table[:, column]) for column in range(3))
    return Proposals(np.array(times, np.int64), x, y, r, table[:, 3:], window_us, detector_name(config, method))


def _at(t_us: int, found: Detection) -> Detection:
    """The ball as far as it has moved until then: labels have round times. Without a known motion it stays."""
    if not isinstance(found, RefinedDetection):
        return found
    ms = 1e-3 * (t_us - found.t_us)
    return replace(
        found, t_us=t_us, u_px=found.u_px + ms * found.vu_px_per_ms, v_px=found.v_px + ms * found.vv_px_per_ms
    )


def joined_proposals(first: Proposals | None, second: Proposals) -> Proposals:
    """Both, by time; where both have one for the same time, the second's. Another detector's start anew."""
    if first is None or (first.detector, first.window_us) != (second.detector, second.window_us):
        return second
    kept = ~np.isin(first.t_us, second.t_us)
    t_us = np.concatenate([first.t_us[kept], second.t_us])
    order = np.argsort(t_us, kind="stable")

    def join(one: Array, other: Array) -> Array:
        return np.concatenate([one[kept], other])[order]

    return Proposals(
        t_us[order],
        join(first.x_px, second.x_px),
        join(first.y_px, second.y_px),
        join(first.r_px, second.r_px),
        join(first.covariance_px2, second.covariance_px2),
        second.window_us,
        second.detector,
    )


def detector_name(config: DetectorConfig, method: Method) -> str:
    """Method and the first digits of the hash of its settings: what a label says it was proposed by."""
    text = json.dumps(config_to_mapping(config), sort_keys=True)
    return f"{method}#{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def accept(proposals: Proposals, row: int, *, time_spent_ms: int = 0) -> Label:
    """The label that says: this proposal is right."""
    covariance = proposals.covariance_px2[row]
    t_us = int(proposals.t_us[row])
    xx, xy, yy = covariance.tolist()
    return Label(
        t_us=t_us,
        state=LabelState.VISIBLE,
        x_px=float(proposals.x_px[row]),
        y_px=float(proposals.y_px[row]),
        r_px=float(proposals.r_px[row]) if np.isfinite(proposals.r_px[row]) else None,
        covariance_px2=(xx, xy, yy) if np.isfinite(covariance).all() else None,
        provenance=Provenance(
            source=PositionSource.ACCEPTED,
            detector=proposals.detector,
            window_us=(max(t_us - proposals.window_us, 0), max(t_us, 1)),
            time_spent_ms=time_spent_ms,
        ),
    )


def steady_segment(
    proposals: Proposals,
    t_us: int,
    *,
    tolerance_px: float = 1.0,
    stereo_residual_px: Array | None = None,
) -> NDArray[np.intp]:
    """Rows around `t_us` that can be accepted at once: an unbroken run of windows in which every proposal was snapped,
    agrees with its neighbours within `tolerance_px`, and with the other camera's where `stereo_residual_px` (N,) is
    known. Empty if the proposal at `t_us` itself does not.

    Args:
        proposals: in order of time.
        t_us: time inside of the run.
        tolerance_px: largest distance from what the neighbours predict.
        stereo_residual_px: (N,) distance from the other camera's; nan: not known.
    """
    if not len(proposals):
        return np.empty(0, np.intp)
    residual = residual_of_neighbours(
        proposals.t_us, proposals.x_px, proposals.y_px, max_gap_us=2 * proposals.window_us
    )
    fine = (residual <= tolerance_px) & np.isfinite(proposals.covariance_px2[:, 0])
    if stereo_residual_px is not None:
        fine &= ~(stereo_residual_px > tolerance_px)  # nan: nothing speaks against it
    at = int(np.argmin(np.abs(proposals.t_us - t_us)))
    if not fine[at] or abs(int(proposals.t_us[at]) - t_us) > proposals.window_us:
        return np.empty(0, np.intp)
    joined = np.diff(proposals.t_us) <= 2 * proposals.window_us
    first = last = at
    while first > 0 and fine[first - 1] and joined[first - 1]:
        first -= 1
    while last + 1 < len(proposals) and fine[last + 1] and joined[last]:
        last += 1
    return np.arange(first, last + 1)
