"""Trace of one window of the refined detector: a frozen value per stage, recorded while the detector itself runs.

The recorder only copies what the detector computes anyway, so that the answer is the same bit for bit; without one a
step takes no longer.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.reasons import Reason
from core.detection.refined.attempts import Attempt, Origin, blob_reasons
from core.detection.refined.ball_fit import Quality, Reach, Work, span_for
from core.detection.refined.circle_fit import Fit
from core.detection.refined.history import Recent
from core.detection.refined.patch import SIDE, MovingCircle
from core.detection.refined.search import SPANS_US, Blobs, Maps, surviving_events
from core.detection.refined.track import BallTrack
from core.detection.refined_config import RefinedConfig

BlobStatus = Literal["waiting", "examined", "tracked", "rejected"]
"""Whether a blob had to wait for a later window, was examined, is a track's, or is beyond a limit."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchTrace:
    """Pixels that survive the opening over one time span."""

    span_us: int
    evaluated: bool
    """Whether blobs were made of them in this window; long spans are evaluated every few windows."""
    x_px: NDArray[np.uint16]
    """(N,) pixels with an event within the span and enough such neighbours at the end of the window."""
    y_px: NDArray[np.uint16]


@dataclass(frozen=True, slots=True, eq=False)
class BlobTrace:
    """Joined cells of surviving pixels."""

    box_px: tuple[float, float, float, float]
    """u and v of the middle, width, height."""
    span_us: int
    status: BlobStatus
    reasons: tuple[Reason, ...] = ()
    """The limits that it failed; of those that failed one the largest is listed."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeTrace:
    """The edge points of one fit, and the pixels inside its disc."""

    u_px: NDArray[np.float64]
    """(N,) pixel of each point, as its event has it."""
    v_px: NDArray[np.float64]
    moved_px: NDArray[np.float64]
    """(N, 2) where it is on the circle at the end of the window, with the ball's motion taken out."""
    ms: NDArray[np.float64]
    """(N,) time of its event before the end of the window, negative."""
    leading: NDArray[np.bool_]
    """(N,) whether it is of the leading edge; else of the trailing one."""
    weight: NDArray[np.float64]
    """(N,) weight in the last iteration; below one half it is an outlier."""
    residual_px: NDArray[np.float64]
    """(N,) distance from the circle, positive outside."""
    angle_rad: NDArray[np.float64]
    """(N,) direction from the centre, from the direction of motion, -pi to pi."""
    inside_px: NDArray[np.int64]
    """(M, 2) pixels whose events count as inside the disc."""

    @property
    def outlier(self) -> NDArray[np.bool_]:
        """(N,) points that hardly count."""
        return self.weight < 0.5


@dataclass(frozen=True, slots=True, eq=False)
class FitTrace:
    """One attempt to fit a ball."""

    number: int
    origin: Origin
    blob: int | None
    """Number of the blob that it started from."""
    start: MovingCircle | None
    """The expected circle, or the first estimate."""
    ball: MovingCircle | None
    """The fitted circle; None without a fit."""
    quality: Quality | None
    history_ms: float
    """Age of the oldest edge points that may be used."""
    edges: EdgeTrace | None
    reasons: tuple[Reason, ...]
    """The limits that it failed; empty if it became, or continued, a track."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackTrace:
    """A track after this window."""

    ball: MovingCircle
    fit: int | None
    """Number of this window's fit; None if it was not seen in this window."""
    fits: int
    evidence: float
    age_us: int
    unseen_us: int
    confirmed: bool
    missing: tuple[Reason, ...]
    """What it lacks to be confirmed."""
    given_up: tuple[Reason, ...]
    """Why it was given up in this window; empty if it goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class RefinedTrace:
    """All stages of one window."""

    end_us: int
    history_events: int
    """Events kept in the history, this window's among them."""
    history_us: int
    """Age of the oldest one."""
    searched: bool
    """Whether there was a search; while a ball is tracked there is none."""
    spans: tuple[SearchTrace, ...]
    blobs: tuple[BlobTrace, ...]
    fits: tuple[FitTrace, ...]
    tracks: tuple[TrackTrace, ...]
    detection: Detection | None
    delay_us: int
    """Time before the end of the window at which the detection is valid: the sensor's delay, taken out."""
    seconds: float
    """Run time of the step, recording included."""


class TraceRecorder:
    """Collects the intermediate results of one step."""

    def __init__(self, config: RefinedConfig, end_us: int) -> None:
        self._config = config
        self._end_us = end_us
        self._began_s = time.perf_counter()
        self._searched = False
        self._spans: tuple[SearchTrace, ...] = ()
        self._rejected: tuple[BlobTrace, ...] = ()
        self._boxes: list[tuple[tuple[float, float, float, float], int]] = []
        self._statuses: dict[int, BlobStatus] = {}
        self._blob: int | None = None
        self._start: MovingCircle | None = None
        self._history_ms = 0.0
        self._fits: list[FitTrace] = []

    def take_search(self, recent: Recent, maps: Maps, blobs: Blobs, found: int, evaluated: Sequence[bool]) -> None:
        """Record a search that found so many blobs, and which time spans it evaluated."""
        self._searched = True
        spans = []
        for number, span_us in enumerate(SPANS_US.tolist()):
            rows = surviving_events(recent, self._end_us, span_us, maps, self._config.neighbours_min)
            # Indexing copies, and must: the history is overwritten later.
            spans.append(SearchTrace(span_us, evaluated[number], recent.x_px[rows], recent.y_px[rows]))
        self._spans = tuple(spans)
        for blob in range(found):
            u, v, width, height = blobs.boxes[blob].tolist()
            self._boxes.append(((u, v, width, height), int(SPANS_US[blobs.span[blob]])))

        u, v, width, height, cells, span = blobs.rejected.tolist()
        if cells:
            why = blob_reasons(blobs.rejected, self._config)
            self._rejected = (BlobTrace((u, v, width, height), int(SPANS_US[int(span)]), "rejected", why),)

    def take_blob(self, blob: int, status: BlobStatus) -> None:
        """Record that it is a blob's turn."""
        self._statuses[blob] = status
        self._blob = blob

    def begin_fit(self, fit: Fit, reach: Reach) -> None:
        """Record the start of a fit."""
        self._start = MovingCircle(*fit.estimate.tolist(), *fit.bend.tolist())
        speed = float(np.hypot(self._start.vu, self._start.vv))
        self._history_ms = span_for(self._end_us, speed, reach).history_ms

    def end_fit(self, origin: Origin, work: Work, ball: MovingCircle, quality: Quality) -> None:
        """Record a fit; `refuse` follows if it is refused."""
        bend = work.fit.bend.tolist()
        self._add(origin, ball, quality, _edges_of(work, ball._replace(au=bend[0], av=bend[1])))

    def refuse(self, attempt: Attempt) -> None:
        """Record why the last attempt was refused."""
        if attempt.ball is None:
            self._start = attempt.start or (None if attempt.few_events else self._start)
            self._add(attempt.origin, None, None, None)
        last = self._fits[-1]
        self._fits[-1] = FitTrace(
            last.number, last.origin, last.blob, last.start, last.ball, last.quality, last.history_ms, last.edges,
            attempt.reasons(self._config),
        )  # fmt: skip

    def finish(
        self, recent: Recent, tracks: Sequence[BallTrack], brighter: float, detection: Detection | None
    ) -> RefinedTrace:
        """The whole trace, after the step."""
        seconds = time.perf_counter() - self._began_s
        by_ball = {id(fit.ball): fit.number for fit in self._fits if fit.ball is not None}
        oldest_us = int(recent.t_us[0]) if len(recent.t_us) else self._end_us
        return RefinedTrace(
            end_us=self._end_us,
            history_events=len(recent.t_us),
            history_us=self._end_us - oldest_us,
            searched=self._searched,
            spans=self._spans,
            blobs=tuple(
                BlobTrace(box, span_us, self._statuses.get(number, "waiting"))
                for number, (box, span_us) in enumerate(self._boxes)
            )
            + self._rejected,
            fits=tuple(self._fits),
            tracks=tuple(
                TrackTrace(
                    ball=one.ball,
                    fit=by_ball.get(id(one.ball)),
                    fits=one.fits,
                    evidence=one.evidence,
                    age_us=self._end_us - one.initial_us,
                    unseen_us=self._end_us - one.end_us,
                    confirmed=one.confirmed,
                    missing=() if one.confirmed else one.missing(self._config, brighter),
                    given_up=one.given_up(),
                )
                for one in tracks
            ),
            detection=detection,
            delay_us=self._config.delay_us,
            seconds=seconds,
        )

    def _add(self, origin: Origin, ball: MovingCircle | None, quality: Quality | None, edges: EdgeTrace | None) -> None:
        blob = self._blob if origin == "blob" else None
        number = len(self._fits)
        self._fits.append(FitTrace(number, origin, blob, self._start, ball, quality, self._history_ms, edges, ()))


def _edges_of(work: Work, ball: MovingCircle) -> EdgeTrace:
    """Copy of the edge points of the last fit, measured against its circle as the fit does it."""
    found, touched, x0, y0 = work.counts.tolist()
    points, patch = work.points, work.patch
    u, v, t = (column[:found].copy() for column in (points.u, points.v, points.ms))
    leading = points.lead[:found] != 0.0
    ms = t + np.where(leading, ball.stretch, -ball.stretch)
    du = u - ball.u - (ball.vu + 0.5 * ball.au * ms) * ms
    dv = v - ball.v - (ball.vv + 0.5 * ball.av * ms) * ms
    turn = np.arctan2(dv, du) - np.arctan2(ball.vv, ball.vu)
    rows, columns = np.divmod(patch.touched[:touched][patch.interior[:touched]].astype(np.int64), SIDE + 2)
    return EdgeTrace(
        u_px=u,
        v_px=v,
        moved_px=np.column_stack([ball.u + du, ball.v + dv]),
        ms=t,
        leading=leading,
        weight=points.weight[:found].copy(),
        residual_px=np.hypot(du, dv) - ball.r,
        angle_rad=(turn + np.pi) % (2 * np.pi) - np.pi,
        inside_px=np.column_stack([columns + x0, rows + y0]),
    )
