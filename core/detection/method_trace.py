"""One window through any method, in the form in which Tune draws it and `detect --explain` prints it.

Each method has a trace of its own with all it knows; this is what they have in common: views of the sensor, counts for
each stage, and a table of candidates with their verdicts.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.detection.detector import Detection, Detector
from core.detection.reasons import Reason, reasons_of
from core.detection.stages.roi import Roi
from core.events import Events, Window

OFF, ON, NOISE, LEADING, TRAILING, INSIDE, OUTLIER = -1, -2, -3, -4, -5, -6, -7
"""What a pixel of a view shows; from 0 on it is of the candidate, or the group, of this number."""
Role = Literal["accepted", "rejected", "waiting", "region"]
"""What a shape of a view is: of a candidate that is still in, one that is out, one whose turn is later, or the limits
of what is searched."""
RAW: Final = "raw"
RESULT: Final = "result"
PLAIN_VIEWS: Final = (RAW, RESULT)
"""Views of a method without a trace: its events, and its answer."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelLayer:
    """Coloured pixels over the dimmed events of the window; where some overlap the last one is seen."""

    x_px: NDArray[np.integer]
    """(N,)"""
    y_px: NDArray[np.integer]
    kind: NDArray[np.int16]
    """(N,) see `OFF` and the others."""

    @staticmethod
    def of_events(events: Events, kind: ArrayLike | None = None) -> PixelLayer:
        """Pixels of events, of one kind or one each; by polarity without."""
        kinds = np.where(events.on, ON, OFF) if kind is None else np.broadcast_to(kind, len(events))
        return PixelLayer(events.x_px, events.y_px, kinds.astype(np.int16))

    @staticmethod
    def joined(layers: Sequence[PixelLayer]) -> PixelLayer:
        """The pixels of several layers, the last one above."""
        none = np.zeros(0, np.int64)
        return PixelLayer(
            np.concatenate([none, *(one.x_px for one in layers)]),
            np.concatenate([none, *(one.y_px for one in layers)]),
            np.concatenate([none, *(one.kind for one in layers)]).astype(np.int16),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A line, a polygon or a circle in a view, with a text beside it."""

    role: Role
    points_px: NDArray[np.float64]
    """(N, 2) corners; of a circle its centre alone."""
    radius_px: float | None = None
    """None for a line or a polygon."""
    text: str = ""
    text_px: tuple[float, float] = (0.0, 0.0)
    """Where the text begins."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What one stage kept, as a picture of the sensor."""

    name: str
    """As on its button."""
    group: str
    """The group of sliders that belongs to it, see `setting_group`."""
    pixels: PixelLayer | None
    """None: all events of the window, undimmed."""
    shapes: tuple[Outline, ...] = ()
    dots_px: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) points between pixels."""
    dot_kinds: NDArray[np.int16] = field(default_factory=lambda: np.zeros(0, np.int16))
    """(N,) as of pixels."""
    shows_ball: bool = True
    """Whether the detection is drawn as well."""


@dataclass(frozen=True, slots=True)
class StageCount:
    """What came into a stage and what it kept."""

    count_in: int
    count_out: int
    unit: str = "events"
    unit_in: str = ""
    """What `count_in` counts, where that is not `unit`."""
    seconds: float | None = None
    """Run time; None if the stages are not timed one by one."""


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Distances of the edge points from a candidate's circle."""

    angle_rad: NDArray[np.float64]
    """(N,) direction from the centre, from the direction of motion, -pi to pi."""
    residual_px: NDArray[np.float64]
    """(N,) positive outside."""
    kind: NDArray[np.int16]
    """(N,) LEADING, TRAILING or OUTLIER."""
    limit_px: float
    """Largest root mean square of them."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateRow:
    """A row of the table of candidates."""

    label: int
    figures: tuple[str, ...]
    """One for each title of the table."""
    reasons: tuple[Reason, ...]
    """The limits that it failed."""
    verdict: str
    """Its state if it failed none: "ball"."""
    order: float
    """Rows of the same kind are sorted by this, the largest first."""
    x_px: NDArray[np.number]
    y_px: NDArray[np.number]
    """(N,) where a click chooses it."""
    residuals: Residuals | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MethodTrace:
    """One window through a method."""

    views: tuple[View, ...]
    counts: Mapping[str, StageCount]
    """By group of sliders."""
    noun: str
    """What a candidate is called: "cluster"."""
    titles: tuple[str, ...]
    """Titles of the candidates' figures."""
    candidates: tuple[CandidateRow, ...]
    detection: Detection | None
    reasons: tuple[Reason, ...]
    """Why there is no ball, of the nearest candidate; empty with one."""
    where: str = ""
    """What was searched, as a phrase."""
    centre_px: tuple[float, float] | None = None
    """Centre of what was searched, where a zoomed view looks without a ball."""

    def view(self, name: str) -> View:
        """The view of this name; the last one, the result, if there is none."""
        return next((one for one in self.views if one.name == name), self.views[-1])


@runtime_checkable
class ExplainingDetector(Protocol):
    """A detector that shows its stages, which is optional."""

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window with its trace; the answer, in it, is that of `step`."""
        ...


def explain_step(detector: Detector, window: Window) -> MethodTrace:
    """One step of any detector with its trace; of one that shows no stages the answer, and why there is none."""
    if isinstance(detector, ExplainingDetector):
        return detector.explain(window)
    start_s = time.perf_counter()
    detection = detector.step(window)
    seconds = time.perf_counter() - start_s
    reasons = () if detection is not None else reasons_of(detector)
    return MethodTrace(
        views=(View(RAW, setting_group("window"), None), View(RESULT, "", None)),
        counts={"window": StageCount(len(window.events), len(window.events), seconds=seconds)},
        noun="candidate",
        titles=(),
        candidates=(),
        detection=detection,
        reasons=reasons,
    )


def setting_group(section: str, stage: str = "") -> str:
    """Name of a group of sliders: a section of the config, or a stage in it."""
    return f"{section}.{stage}" if stage else section


def circle_points(u_px: float, v_px: float) -> NDArray[np.float64]:
    """Centre of a circle as the points of a `Outline`."""
    return np.array([[u_px, v_px]])


def box_points(u_px: float, v_px: float, width_px: float, height_px: float) -> NDArray[np.float64]:
    """(4, 2) corners of a box round (u, v).

    Args:
        u_px: column of the centre.
        v_px: row of the centre.
        width_px: full width.
        height_px: full height.
    """
    x, y = 0.5 * width_px, 0.5 * height_px
    return np.array([(u_px - x, v_px - y), (u_px + x, v_px - y), (u_px + x, v_px + y), (u_px - x, v_px + y)])


def region_shapes(roi: Roi | None) -> tuple[Outline, ...]:
    """Outline of a region of interest; nothing for the whole sensor."""
    if roi is None:
        return ()
    u, v = (roi.x_min + roi.x_max) / 2, (roi.y_min + roi.y_max) / 2
    return (Outline("region", box_points(u, v, roi.x_max - roi.x_min + 1, roi.y_max - roi.y_min + 1)),)
