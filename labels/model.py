"""What a label says: where the ball is at an instant in one camera, or when it touches something; how sure, by whom."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

from core.errors import LabelError


class LabelState(StrEnum):
    """What a person saw. A time nobody looked at has no label: *unchecked* is not a state and never a negative."""

    VISIBLE = "visible"
    PARTLY_OCCLUDED = "partly_occluded"
    """Something hides a part of the ball; the centre is that of the whole ball."""
    OCCLUDED = "occluded"
    """In the picture but hidden; a position, if given, is inferred."""
    OUT_OF_FRAME = "out_of_frame"
    """In play but outside the picture; a position, if given, may lie outside the sensor."""
    NO_BALL = "no_ball"

    @property
    def seen(self) -> bool:
        """Whether a detector can be asked to find this ball."""
        return self in (LabelState.VISIBLE, LabelState.PARTLY_OCCLUDED)


class PositionSource(StrEnum):
    """How a position came about; evaluations report each apart, because accepting a proposal anchors the eye."""

    BY_HAND = "by_hand"
    SNAPPED = "snapped"
    """Clicked by hand, then moved to the circle that fits the events."""
    EPIPOLAR = "epipolar"
    """Clicked by hand on the epipolar curve of the other camera's label."""
    CORRECTED = "corrected"
    """Proposed by a detector, then moved by hand."""
    ACCEPTED = "accepted"
    """Proposed by a detector and accepted as it was."""
    INTERPOLATED = "interpolated"
    IMPORTED = "imported"
    SETTLED = "settled"
    """Made to settle a conflict with another annotator's label, which was seen beside one's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Who, when, with what and from what. The store fills annotator, time and tool where they are empty."""

    source: PositionSource = PositionSource.BY_HAND
    annotator: str = ""
    made_at_us: int = 0
    """Microseconds since 1970, UTC."""
    tool: str = ""
    """Program and version."""
    detector: str = ""
    """Method and hash of the config of the proposal that was accepted or corrected, the file that was imported, or what
    a conflict was settled over, as `labels.conflicts.settlement` has it."""
    window_us: tuple[int, int] | None = None
    """[start, end) of the events (or of the exposure) that the picture showed."""
    rendering: str = ""
    """How the picture was drawn: polarity, count, time_surface, frame."""
    time_spent_ms: int = 0

    def __post_init__(self) -> None:
        window = self.window_us
        if window is not None and not window[0] < window[1]:
            raise LabelError("the window of a label is empty", expected="start before end", got=window)


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """One instant of one camera, in pixels of the raw, distorted picture; (0.0, 0.0) is the first pixel's centre."""

    t_us: int
    """The instant at which the position holds; with recording and camera it is the label's identity."""
    state: LabelState
    x_px: float | None = None
    y_px: float | None = None
    r_px: float | None = None
    """Radius of the ball; None: not judged."""
    covariance_px2: tuple[float, float, float] | None = None
    """(xx, xy, yy) of the centre; None: not known."""
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        where = f"label at {self.t_us} us"
        if not 0 <= self.t_us < 2**63:
            raise LabelError("impossible time", expected="microseconds from 0", got=self.t_us, where=where)
        if (self.x_px is None) != (self.y_px is None):
            raise LabelError("half a position", got=f"x {self.x_px}, y {self.y_px}", where=where)
        numbers = (self.x_px, self.y_px, self.r_px, *(self.covariance_px2 or ()))
        if not all(number is None or math.isfinite(number) for number in numbers):
            raise LabelError("not finite", expected="x, y, r as numbers", got=numbers, where=where)
        if self.state.seen and self.x_px is None:
            raise LabelError(f"{self.state} without a position", expected="x and y in pixels", where=where)
        if self.state is LabelState.NO_BALL and self.x_px is not None:
            raise LabelError("a position where there is no ball", got=(self.x_px, self.y_px), where=where)
        if self.r_px is not None and not self.r_px > 0:
            raise LabelError("impossible radius", expected="above 0 px", got=self.r_px, where=where)
        if self.covariance_px2 is not None:
            xx, xy, yy = self.covariance_px2
            if not (xx >= 0 and yy >= 0 and xx * yy >= xy * xy * (1 - 1e-9)):
                raise LabelError("not a covariance", got=self.covariance_px2, where=where)


class ContactKind(StrEnum):
    """What the ball touches."""

    BOUNCE = "bounce"
    """The table's top."""
    HIT = "hit"
    """A racket."""
    NET = "net"
    """The net or its posts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLabel:
    """One contact of the ball, as the annotator of a layer has it. Its time is its identity within the layer."""

    t_us: int
    """The instant of the contact, us on the recording's clock."""
    kind: ContactKind
    sigma_us: float | None = None
    """Standard deviation of the time; None: not known."""
    provenance: Provenance = field(default_factory=Provenance)
    """`source` says how the time came about, `detector` by which method where one proposed it."""

    def __post_init__(self) -> None:
        where = f"contact at {self.t_us} us"
        if not 0 <= self.t_us < 2**63:
            raise LabelError("impossible time", expected="microseconds from 0", got=self.t_us, where=where)
        if self.sigma_us is not None and not (math.isfinite(self.sigma_us) and self.sigma_us >= 0):
            raise LabelError("impossible uncertainty", expected="0 us or more", got=self.sigma_us, where=where)
