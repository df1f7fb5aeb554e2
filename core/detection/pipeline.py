"""The readable detector: one window through all stages, with every intermediate result. The fast path must agree."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.config import DetectorConfig
from core.detection.detector import Detection
from core.detection.reasons import Reason
from core.detection.stage_trace import Candidate, PipelineTrace, StageTrace, TrackState
from core.detection.stages.cluster import ClusterConfig, cluster_labels, size_reason
from core.detection.stages.denoise import survives_opening
from core.detection.stages.flicker import FlickerMemory, keep_steady_pixels
from core.detection.stages.geometry import measure_shape, shape_reasons
from core.detection.stages.hot_pixels import HotPixelMemory, keep_cool_pixels
from core.detection.stages.localise import circle_reason, enclosing_circle
from core.detection.stages.polarity import addresses, near_centroid, on_evidence, on_leads, remember
from core.detection.stages.roi import inside_roi, next_region, roi_around
from core.events import Events, Window

LabelClusters = Callable[[Events, ClusterConfig], NDArray[np.int32]]
"""From events to the number of each event's cluster, -1 for none."""


class ReferenceDetector:
    """The readable pipeline as a detector."""

    def __init__(self, config: DetectorConfig) -> None:
        self.config = config
        self.state = TrackState()
        self.extra_circles = 0

    def reset(self) -> None:
        """Forget everything seen before."""
        self.state = TrackState()
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None."""
        trace = trace_window(window, self.state, self.config)
        self.state, self.extra_circles = trace.state, trace.extra_circles
        return trace.detection


def trace_window(
    window: Window, state: TrackState, config: DetectorConfig, *, label_clusters: LabelClusters = cluster_labels
) -> PipelineTrace:
    """Run every stage on one window. Neither the window nor the state is changed; the next state is in the trace.

    `label_clusters` may be `fast.cluster.grid_labels`, which gives the same labels as scikit-learn and takes
    milliseconds where that takes seconds; the default keeps this pipeline independent of the fast path.
    """
    clock = _StageClock()
    whole, hot_pixels, flicker = _drop_bad_pixels(window.events, state, config, clock)
    with clock.time("roi"):
        roi = roi_around(state.centre_px, config.roi)
        seen = whole if roi is None else whole.rows(inside_roi(whole, roi))
    clock.close("roi", whole, seen)
    with clock.time("denoise"):
        clean = seen.rows(survives_opening(seen, config.denoise))
    clock.close("denoise", seen, clean)
    with clock.time("cluster"):
        labels = label_clusters(clean, config.cluster)
        clustered = clean.rows(labels >= 0)
        clusters = [np.flatnonzero(labels == label) for label in range(int(labels.max(initial=-1)) + 1)]
    found = [
        _examine(label, clean, clustered, rows, state.on_leads, config, clock) for label, rows in enumerate(clusters)
    ]
    # What a stage leaves is the union over the clusters: each was examined alone, Tune shows the stage as one
    # picture.
    kept = clean
    for number, name in enumerate(_CANDIDATE_STAGES):
        left = [one for one in found if one.rejected_by not in _CANDIDATE_STAGES[: number + 1]]
        rows = [one.rows if name == "cluster" else one.leading_rows for one in left]
        before, kept = kept, clean.rows(np.sort(np.concatenate([np.zeros(0, np.intp), *rows])))
        clock.close(name, before, kept)

    t_us = window.end_us - config.localise.delay_us
    balls = [one for one in found if one.rejected is None]
    ball = _choose(balls, state.centre_px if roi else None)
    circle = None if ball is None else ball.circle
    evidence = None if ball is None else ball.leading_evidence
    found_px = None if circle is None else (circle.u_px, circle.v_px)
    centre_px, misses = next_region(state.centre_px, state.misses, found_px, config.roi)
    memory = remember(state.on_leads, evidence, window.end_us - window.start_us, config.polarity)
    return PipelineTrace(
        stages=tuple(clock.stages),
        roi=roi,
        labels=labels,
        candidates=tuple(found),
        leading_on=on_leads(0.0, state.on_leads, config.polarity) if ball is None else ball.leading_on,
        detection=None if circle is None else Detection(t_us, circle.u_px, circle.v_px, circle.r_px),
        extra_circles=max(0, len(balls) - 1),
        state=TrackState(centre_px, misses, memory, hot_pixels, flicker),
    )


SAME_CIRCULARITY: Final = 1e-9
"""Difference below which two clusters are equally round; the first one is then taken."""

_CANDIDATE_STAGES = ("cluster", "polarity", "geometry", "localise")


class _StageClock:
    """Collects each stage's result and run time."""

    def __init__(self) -> None:
        self.stages: list[StageTrace] = []
        self._seconds: dict[str, float] = {}

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        start_s = time.perf_counter()
        yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - start_s

    def close(self, name: str, before: Events, after: Events) -> None:
        self.stages.append(StageTrace(name, after, len(before), len(after), self._seconds.get(name, 0.0)))


def _drop_bad_pixels(
    events: Events, state: TrackState, config: DetectorConfig, clock: _StageClock
) -> tuple[Events, HotPixelMemory | None, FlickerMemory | None]:
    """Run the optional stages before the paper's."""
    hot_pixels, flicker = None, None
    if config.hot_pixels.enabled:
        before = events
        with clock.time("hot_pixels"):
            hot_pixels = state.hot_pixels.copy() if state.hot_pixels else HotPixelMemory.blank(events.sensor)
            events = events.rows(keep_cool_pixels(events, hot_pixels, config.hot_pixels))
        clock.close("hot_pixels", before, events)
    if config.flicker.enabled:
        before = events
        with clock.time("flicker"):
            flicker = state.flicker.copy() if state.flicker else FlickerMemory.blank(events.sensor)
            events = events.rows(keep_steady_pixels(events, flicker, config.flicker))
        clock.close("flicker", before, events)
    return events, hot_pixels, flicker


def _examine(
    label: int,
    clean: Events,
    clustered: Events,
    rows: NDArray[np.intp],
    remembered: float,
    config: DetectorConfig,
    clock: _StageClock,
) -> Candidate:
    """Take one cluster through the remaining stages; the first that rejects it is named, the others still measure."""
    events = clean.rows(rows)
    reasons = [("cluster", size_reason(len(rows), config.cluster))]
    with clock.time("polarity"):
        evidence = 0.0
        if config.polarity.leading_polarity == "auto":
            # With events of the other clusters near: the two edges of a large ball are often two clusters.
            evidence = on_evidence(
                clustered.rows(near_centroid(addresses(clustered), addresses(events), config.polarity.pair_radius_px))
            )
        leading_on = on_leads(evidence, remembered, config.polarity)
        leading_rows = rows[events.on == leading_on]
        edge_px = addresses(clean.rows(leading_rows))
        leading_rows = leading_rows[near_centroid(edge_px, edge_px, config.polarity.outlier_radius_px)]
        leading = clean.rows(leading_rows)
        reasons.append(("polarity", None if len(leading) else _no_edge(leading_on)))
    shape, circle = None, None
    if len(leading):
        with clock.time("geometry"):
            shape = measure_shape(addresses(leading))
            reasons += [("geometry", reason) for reason in shape_reasons(shape, config.geometry)]
        with clock.time("localise"):
            circle = enclosing_circle(shape.hull_px)
            reasons.append(("localise", circle_reason(circle, config.localise)))
    failed = [(stage, why) for stage, why in reasons if why is not None]
    return Candidate(
        label=label,
        rows=rows,
        events=events,
        leading_on=leading_on,
        leading_evidence=evidence,
        leading_rows=leading_rows,
        leading_events=leading,
        shape=shape,
        circle=circle,
        reasons=tuple(why for _, why in failed),
        rejected_by=failed[0][0] if failed else None,
    )


def _no_edge(leading_on: bool) -> Reason:
    text = f"no {'ON' if leading_on else 'OFF'} events"
    return Reason("events of the leading polarity", "polarity.leading_polarity", 0, 1, sentence=text)


def _choose(balls: Sequence[Candidate], centre_px: tuple[float, float] | None) -> Candidate | None:
    """The candidate nearest to the centre of the region of interest, on the whole sensor the most circular one."""
    best, least = None, math.inf
    for ball in balls:
        assert ball.shape and ball.circle
        u, v = centre_px or (0.0, 0.0)
        off = (ball.circle.u_px - u) ** 2 + (ball.circle.v_px - v) ** 2
        badness = off if centre_px else -ball.shape.circularity
        if badness < least - SAME_CIRCULARITY:
            best, least = ball, badness
    return best
