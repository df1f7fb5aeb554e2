"""Attempts to fit a ball that were refused in a window, and the reasons why the window has none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.reasons import Limit, Reason, failed_limits
from core.detection.refined.ball_fit import FEWEST_EVENTS, FEWEST_POINTS, Quality
from core.detection.refined.history import Recent
from core.detection.refined.patch import MovingCircle
from core.detection.refined.search import CELL_PX
from core.detection.refined.track import BallTrack, fit_limits, fit_values
from core.detection.refined_config import RefinedConfig

Origin = Literal["blob", "track", "bounce"]
"""What a fit starts from: a blob of the search, a track's prediction, or that with a bounce."""
BLOB_SIDE: Final = 4.0
"""Times the largest radius of a ball that the longest side of a blob may have: the ball and its way."""
START_RADIUS: Final = (0.6, 1.5)
"""Times the smallest and the largest radius of a ball that the first estimate of one may have."""


class Attempt(NamedTuple):
    """A fit that was refused, with what decides about it."""

    origin: Origin
    ball: MovingCircle | None = None
    """None if there is no fit."""
    quality: Quality | None = None
    points: int = 0
    """Edge points of an attempt without a fit."""
    few_events: bool = False
    """Whether the blob has too few events, or all at one time, for a first estimate."""
    start: MovingCircle | None = None
    """The first estimate, if that was refused."""
    on_sensor: bool = True
    confirmed: bool = False
    """Whether it would have continued a confirmed ball."""
    track: BallTrack | None = None
    """The track that the fit does not belong to although it is a possible ball, with its distance and the limit."""
    apart_px: float = 0.0
    most_px: float = math.inf

    def reasons(self, config: RefinedConfig) -> tuple[Reason, ...]:
        """Every limit that it failed."""
        if self.few_events:
            return (
                Reason(
                    "events of a blob",
                    None,
                    None,
                    FEWEST_EVENTS,
                    sentence=f"fewer than {FEWEST_EVENTS} events, or all at one time",
                ),
            )
        if self.start is not None:
            return failed_limits(_start_values(self.start), _start_limits(config))
        if self.ball is None or self.quality is None:
            if self.points < max(FEWEST_POINTS, config.points_min):
                return (Reason("edge points", "refined.points_min", self.points, config.points_min),)
            return (Reason("no circle through the edge points"),)
        if self.track is not None:
            apart = Limit("distance from the prediction", None, 0.0, self.most_px, "px")
            differs = self.track.differs_in(self.ball, self.quality) if self.track.confirmed else ()
            return (*failed_limits([self.apart_px], [apart]), *differs)
        border = () if self.on_sensor else (Reason("centre outside the picture"),)
        return (
            *failed_limits(fit_values(self.ball, self.quality), fit_limits(config, confirmed=self.confirmed)),
            *border,
        )


def _start_values(start: MovingCircle) -> tuple[float, ...]:
    return start.r, start.r, math.hypot(start.vu, start.vv)


def _start_limits(config: RefinedConfig) -> tuple[Limit, ...]:
    low, high = START_RADIUS
    return (
        Limit("first radius", "refined.radius_min_px", low * config.radius_min_px, math.inf, "px"),
        Limit("first radius", "refined.radius_max_px", -math.inf, high * config.radius_max_px, "px"),
        Limit("first speed", "refined.speed_max_px_per_ms", -math.inf, config.speed_max_px_per_ms, "px/ms"),
    )


def reasons_without_ball(
    end_us: int,
    recent: Recent,
    blobs: int | tuple[Reason, ...],
    refused: Sequence[Attempt],
    tracks: Sequence[BallTrack],
    given_up: Sequence[BallTrack],
    config: RefinedConfig,
    brighter: float,
) -> tuple[Reason, ...]:
    """Why a window has no ball: the limits that its nearest candidate failed.

    The nearest one is a track that was fitted but given up; else a fitted one that lacks something to be a ball, the
    one that lacks least; else the refused fit with the fewest failed limits, and of these the most edge points; else a
    refused first estimate; else there was nothing to fit. `blobs` is how many there are, or why there is none.

    Args:
        end_us: end of the window.
        recent: events of the history.
        blobs: how many the search found, or why none.
        refused: fits that this window refused.
        tracks: those that go on.
        given_up: those that ended.
        config: the limits.
        brighter: contrast of the last ball, -1 (darker) to 1; what differs needs more evidence.
    """
    for track in given_up:
        if track.end_us == end_us:
            return track.given_up()
    fitted = [track.missing(config, brighter) for track in tracks if track.end_us == end_us and not track.confirmed]
    if fitted:
        return min(fitted, key=len)
    if refused:
        return min(((one, one.reasons(config)) for one in refused), key=lambda pair: _distance(*pair))[1]
    if not len(recent.t_us):
        return (Reason("events in the history", None, 0, 1),)
    if any(track.confirmed for track in tracks):
        return (Reason("the ball is expected outside the picture"),)
    if isinstance(blobs, tuple):
        return blobs
    if len(tracks) >= config.tracks_max:
        taken = f"all {len(tracks)} places for candidates are taken"
        return (Reason("candidates", "refined.tracks_max", len(tracks), config.tracks_max, sentence=taken),)
    return (Reason("blobs wait to be examined", "refined.trials_max", blobs, config.trials_max),)


def blob_reasons(rejected: NDArray[np.float64], config: RefinedConfig) -> tuple[Reason, ...]:
    """Why a search found no blob, from the largest one that was beyond a limit (see `Blobs.rejected`).

    Without one, no pixels survive.
    """
    _, _, width, height, cells, _ = rejected.tolist()
    if not cells:
        return (Reason("blobs of moving pixels", "refined.neighbours_min", 0, 1),)
    longer, shorter, inf = max(width, height), min(width, height), math.inf
    limits = (
        Limit("side of the blob", "refined.radius_max_px", -inf, BLOB_SIDE * config.radius_max_px, "px"),
        Limit("elongation of the blob", "refined.blob_elongation_max", -inf, config.blob_elongation_max),
    )
    return failed_limits([longer, (longer - CELL_PX) / shorter], limits)


def _distance(attempt: Attempt, reasons: Sequence[Reason]) -> tuple[bool, bool, int, float]:
    """Order of refused attempts: those with a fit first, then those that failed the fewest limits."""
    points = attempt.quality.points if attempt.quality else float(attempt.points)
    return attempt.ball is None, attempt.start is None, len(reasons), -points
