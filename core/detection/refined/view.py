"""The trace of the refined detector as views, counts and a table of candidates."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.method_trace import (
    INSIDE,
    LEADING,
    OUTLIER,
    RAW,
    RESULT,
    TRAILING,
    CandidateRow,
    MethodTrace,
    Outline,
    PixelLayer,
    Residuals,
    StageCount,
    View,
    box_points,
    circle_points,
    setting_group,
)
from core.detection.reasons import Reason
from core.detection.refined.patch import MovingCircle
from core.detection.refined.refined_trace import EdgeTrace, FitTrace, RefinedTrace, TrackTrace
from core.events import Window

VIEWS: Final = (RAW, "search", "candidates", "edge points", "fit", "track", RESULT)
"""The stages, as on their buttons."""
TITLES: Final = ("from", "points", "radius [px]", "px/ms", "residual [px]", "coverage", "inside", "fill", "outliers")
NOT_SEARCHED: Final = "not searched: a ball is tracked"
TRAIL_MS: Final = 10.0
"""A track is drawn with the way that it goes in this time."""
ROLES: Final = {"examined": "accepted", "tracked": "region", "waiting": "waiting", "rejected": "rejected"}


def view_of(trace: RefinedTrace, window: Window, reasons: tuple[Reason, ...], residual_px: float) -> MethodTrace:
    """Everything that is shown of a trace.

    Args:
        trace: of one window.
        window: the events that are shown.
        reasons: why there is no ball.
        residual_px: largest residual of a fit, drawn as a limit.
    """
    tracks = {track.fit: track for track in trace.tracks if track.fit is not None}
    return MethodTrace(
        views=_views(trace, tracks),
        counts=_counts(trace, len(window.events)),
        noun="fit",
        titles=TITLES,
        candidates=tuple(_row(fit, tracks.get(fit.number), trace, residual_px) for fit in trace.fits),
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons,
        where="searched for new balls" if trace.searched else NOT_SEARCHED,
    )


def _group(stage: str) -> str:
    return setting_group("refined", stage)


def _counts(trace: RefinedTrace, events: int) -> dict[str, StageCount]:
    pixels = len(np.unique(np.concatenate([one.y_px.astype(np.int64) << 16 | one.x_px for one in trace.spans] or [[]])))
    examined = sum(blob.status == "examined" for blob in trace.blobs)
    fitted = sum(fit.ball is not None for fit in trace.fits)
    points = sum(len(fit.edges.u_px) for fit in trace.fits if fit.edges is not None)
    good = sum(not fit.reasons for fit in trace.fits)
    found = int(trace.detection is not None)
    late = f"ball, at {trace.delay_us} µs before the window's end"
    history, not_run = trace.history_events, "" if trace.searched else NOT_SEARCHED
    return {
        "window": StageCount(events, history, f"events in a history of {1e-3 * trace.history_us:.1f} ms", "new events"),
        _group("search"): StageCount(history, pixels, unit="pixels survive", unit_in="events", not_run=not_run),
        _group("candidates"): StageCount(len(trace.blobs), examined, unit="examined", unit_in="blobs", not_run=not_run),
        _group("edge points"): StageCount(len(trace.fits), points, unit="edge points", unit_in="attempts"),
        _group("fit"): StageCount(fitted, good, unit="within the limits", unit_in="fits"),
        _group("track"): StageCount(len(trace.tracks), found, unit="confirmed and seen", unit_in="tracks"),
        _group("result"): StageCount(found, found, late, "confirmed"),
    }


def _views(trace: RefinedTrace, tracks: dict[int, TrackTrace]) -> tuple[View, ...]:
    spans = [
        PixelLayer(one.x_px, one.y_px, np.full(len(one.x_px), number, np.int16))
        for number, one in reversed(list(enumerate(trace.spans)))
    ]
    survivors = PixelLayer.joined(spans)
    boxes = tuple(
        Outline(
            ROLES[blob.status],  # type: ignore[arg-type]
            box_points(*blob.box_px),
            text=f"{number}: {1e-3 * blob.span_us:g} ms, {blob.reasons[0].text if blob.reasons else blob.status}",
            text_px=(blob.box_px[0] + 0.5 * blob.box_px[2] + 2, blob.box_px[1] - 0.5 * blob.box_px[3]),
        )
        for number, blob in enumerate(trace.blobs)
    )
    edges = [fit.edges for fit in trace.fits if fit.edges is not None]
    pixels = PixelLayer.joined([_edge_pixels(one) for one in edges])
    circles = tuple(shape for fit in trace.fits for shape in _fit_shapes(fit, tracks.get(fit.number)))
    starts = tuple(
        _circle("region", fit.start, f"{fit.number}: {fit.origin}")
        for fit in trace.fits
        if fit.start is not None and 0.0 < fit.start.r < 1e4
    )
    return (
        View(RAW, "window", None, shows_ball=False),
        View("search", _group("search"), survivors, shows_ball=False),
        View("candidates", _group("candidates"), survivors, boxes, shows_ball=False),
        View("edge points", _group("edge points"), pixels, starts, shows_ball=False),
        View("fit", _group("fit"), PixelLayer.joined([]), circles, *_dots(edges), shows_ball=False),
        View("track", _group("track"), PixelLayer.joined([]), tuple(s for t in trace.tracks for s in _track_shapes(t))),
        View(RESULT, _group("result"), None),
    )


def _edge_pixels(edges: EdgeTrace) -> PixelLayer:
    """Pixels of the edge points, as their events have them, and those inside the disc."""
    inside = edges.inside_px
    return PixelLayer.joined(
        [
            PixelLayer(inside[:, 0], inside[:, 1], np.full(len(inside), INSIDE, np.int16)),
            PixelLayer(edges.u_px.astype(np.int64), edges.v_px.astype(np.int64), _kinds(edges)),
        ]
    )


def _kinds(edges: EdgeTrace) -> NDArray[np.int16]:
    sides = np.where(edges.leading, LEADING, TRAILING)
    return np.where(edges.outlier, OUTLIER, sides).astype(np.int16)


def _dots(edges: list[EdgeTrace]) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    """Edge points with the motion of their ball taken out: those of a good fit lie on its circle."""
    places = np.concatenate([np.zeros((0, 2)), *(one.moved_px for one in edges)])
    return places, np.concatenate([np.zeros(0, np.int16), *(_kinds(one) for one in edges)])


def _circle(role: str, ball: MovingCircle, text: str) -> Outline:
    corner = (ball.u + ball.r + 2, ball.v - ball.r)
    return Outline(role, circle_points(ball.u, ball.v), ball.r, text, corner)  # type: ignore[arg-type]


def _fit_shapes(fit: FitTrace, track: TrackTrace | None) -> list[Outline]:
    if fit.ball is None:
        return []
    why = fit.reasons[0].text if fit.reasons else "" if track is None else _state(track)
    return [_circle("rejected" if fit.reasons else "accepted", fit.ball, f"{fit.number}: {why}")]


def _track_shapes(track: TrackTrace) -> list[Outline]:
    ball = track.ball
    way = np.array([(ball.u, ball.v), (ball.u + TRAIL_MS * ball.vu, ball.v + TRAIL_MS * ball.vv)])
    text = f"{_state(track)}, {track.fits} fits, evidence {track.evidence:.1f}, {1e-3 * track.age_us:.0f} ms old"
    role = "rejected" if track.given_up else "accepted" if track.confirmed else "waiting"
    return [_circle(role, ball, text), Outline(role, way)]


def _state(track: TrackTrace) -> str:
    if track.given_up:
        return f"given up: {track.given_up[0].text}"
    if track.confirmed:
        return "ball" if not track.unseen_us else f"ball, unseen for {1e-3 * track.unseen_us:.0f} ms"
    return f"not yet: {track.missing[0].text}" if track.missing else "candidate"


def _row(fit: FitTrace, track: TrackTrace | None, trace: RefinedTrace, residual_px: float) -> CandidateRow:
    ball, quality = fit.ball, fit.quality
    origin = f"blob {fit.blob}" if fit.blob is not None else fit.origin
    figures = ("-",) * (len(TITLES) - 1)
    if ball is not None and quality is not None:
        coverage = 0.5 * (quality.coverage_lead + quality.coverage_trail)
        figures = (
            f"{quality.points:.0f}", f"{ball.r:.1f}", f"{math.hypot(ball.vu, ball.vv):.2f}",
            f"{quality.residual_px:.2f}", f"{coverage:.2f}", f"{quality.inside:.2f}", f"{quality.fill:.2f}",
            f"{quality.stray:.2f}",
        )  # fmt: skip
    elif fit.start is not None:
        start = fit.start
        figures = ("-", f"~{start.r:.1f}", f"~{math.hypot(start.vu, start.vv):.2f}", *figures[3:])
    xs, ys = _places(fit, trace)
    return CandidateRow(
        label=fit.number,
        figures=(origin, *figures),
        reasons=fit.reasons or ((track.given_up or track.missing) if track is not None else ()),
        verdict="ball" if track is not None and track.confirmed else "candidate" if track else "is a track already",
        order=quality.points if quality is not None else -1.0,
        x_px=xs,
        y_px=ys,
        residuals=None if fit.edges is None else Residuals(
            fit.edges.angle_rad, fit.edges.residual_px, _kinds(fit.edges), residual_px
        ),
    )  # fmt: skip


def _places(fit: FitTrace, trace: RefinedTrace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a click chooses an attempt: its edge points, else its start, else its blob."""
    if fit.edges is not None and len(fit.edges.u_px):
        return fit.edges.u_px, fit.edges.v_px
    if fit.start is not None:
        return np.array([fit.start.u]), np.array([fit.start.v])
    if fit.blob is not None:
        u, v, _, _ = trace.blobs[fit.blob].box_px
        return np.array([u]), np.array([v])
    return np.zeros(0), np.zeros(0)
