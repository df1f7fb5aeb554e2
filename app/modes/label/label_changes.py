"""From what a person did to the label it means: pure steps, with a provenance that says how it came about."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from core.events import Events
from labels.assist import Proposals, Snap, snap
from labels.model import Label, LabelState, PositionSource, Provenance

MAX_TIME_MS = 600_000
_STAYS = (PositionSource.CORRECTED, PositionSource.SETTLED)
"""Sources that a label keeps when it is snapped."""
MIN_REACH_PX = 3.0
"""So far from its middle even the smallest ball is still meant: a hand is not steadier."""


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """The picture that a label is judged on."""

    t_us: int
    window_us: tuple[int, int]
    rendering: str
    time_spent_ms: int
    over: str = ""
    """What a label made on it settles, as `labels.conflicts.settlement` says it: another's label was seen beside it."""

    def provenance(self, source: PositionSource, detector: str = "") -> Provenance:
        """Provenance of a label that is made on this picture."""
        return Provenance(
            source=PositionSource.SETTLED if self.over else source,
            detector=self.over or detector,
            window_us=self.window_us,
            rendering=self.rendering,
            time_spent_ms=min(max(self.time_spent_ms, 0), MAX_TIME_MS),
        )


@dataclass(frozen=True, slots=True)
class ProposedLabel:
    """A position that was proposed and that nobody has judged yet."""

    t_us: int
    x_px: float
    y_px: float
    r_px: float | None
    covariance_px2: tuple[float, float, float] | None
    detector: str


@lru_cache(maxsize=16)
def proposed_at(proposals: Proposals, t_us: int) -> ProposedLabel | None:
    """What is proposed at a time; of a few cameras it is kept, as one picture asks for it several times."""
    found = proposals.at(t_us)
    x, y, r = float(found.x_px[0]), float(found.y_px[0]), float(found.r_px[0])
    if not np.isfinite(x):
        return None
    xx, xy, yy = found.covariance_px2[0].tolist()
    covariance = (xx, xy, yy) if np.isfinite(found.covariance_px2[0]).all() else None
    return ProposedLabel(t_us, x, y, r if r > 0 else None, covariance, found.detector)


def label_from_click(
    x_px: float,
    y_px: float,
    shown_picture: ShownPicture,
    before: Label | None,
    draft: ProposedLabel | None,
    *,
    r_px: float | None = None,
) -> Label:
    """A click by hand: the radius stays what it was unless it is given; on a draft that was shown it is a correction.

    A draft beside which was clicked has proposed something else: nothing of it is taken. Of a ball whose radius nobody
    has given yet, it is not known; `PlaceBall` asks for it before anything is stored.

    Args:
        x_px: column, counted from the middle of the first pixel.
        y_px: row.
        shown_picture: time, window and rendering that were looked at.
        before: the label that is there; None: none.
        draft: what is proposed there; None: nothing.
        r_px: radius of a drawn circle.
    """
    known = before if before is not None and before.x_px is not None else None
    if draft is not None and not _means(x_px, y_px, draft):
        draft = None
    source, detector = _source_by_hand(x_px, y_px, known, draft)
    radius = r_px or (known.r_px if known is not None else None) or (draft.r_px if draft is not None else None)
    state = before.state if before is not None and before.state.seen else LabelState.VISIBLE
    made = shown_picture.provenance(source, detector)
    return Label(t_us=shown_picture.t_us, state=state, x_px=x_px, y_px=y_px, r_px=radius, provenance=made)


def snapped(label: Label, events: Events, velocity_px_per_ms: tuple[float, float] | None = None) -> Label:
    """The label moved to the circle that fits the events near it; the same one where none fits."""
    assert label.x_px is not None and label.y_px is not None
    fitted: Snap | None = None
    if velocity_px_per_ms is not None:
        fitted = snap(events, label.t_us, label.x_px, label.y_px, v_px_per_ms=velocity_px_per_ms)
    fitted = fitted or snap(events, label.t_us, label.x_px, label.y_px)
    if fitted is None:
        return label
    made = label.provenance
    source = made.source if made.source in _STAYS else PositionSource.SNAPPED
    return replace(
        label,
        x_px=fitted.x_px,
        y_px=fitted.y_px,
        r_px=fitted.r_px,
        covariance_px2=fitted.covariance_px2,
        provenance=replace(made, source=source),
    )


def accepted(draft: ProposedLabel, shown_picture: ShownPicture) -> Label:
    """The draft, found to be right."""
    return Label(
        t_us=draft.t_us,
        state=LabelState.VISIBLE,
        x_px=draft.x_px,
        y_px=draft.y_px,
        r_px=draft.r_px,
        covariance_px2=draft.covariance_px2,
        provenance=shown_picture.provenance(PositionSource.ACCEPTED, draft.detector),
    )


def moved(label: Label, dx_px: float, dy_px: float, shown_picture: ShownPicture) -> Label | None:
    """The label a little further; None without a position.

    Args:
        label: what is moved.
        dx_px: to the right.
        dy_px: down.
        shown_picture: time, window and rendering that were looked at.
    """
    if label.x_px is None or label.y_px is None:
        return None
    return placed(label, label.x_px + dx_px, label.y_px + dy_px, label.r_px, shown_picture)


def placed(label: Label, x_px: float, y_px: float, r_px: float | None, shown_picture: ShownPicture) -> Label:
    """The label with other numbers, set by hand.

    Args:
        label: what is changed.
        x_px: column, counted from the middle of the first pixel.
        y_px: row.
        r_px: radius; None: not known.
        shown_picture: time, window and rendering that were looked at.
    """
    source, detector = _source_by_hand(x_px, y_px, label, None)
    moved_centre = (x_px, y_px) != (label.x_px, label.y_px)
    state = LabelState.VISIBLE if label.state is LabelState.NO_BALL else label.state
    return replace(
        label,
        state=state,
        x_px=x_px,
        y_px=y_px,
        r_px=r_px,
        covariance_px2=None if moved_centre else label.covariance_px2,
        provenance=shown_picture.provenance(source, detector),
    )


def with_state(
    state: LabelState, before: Label | None, draft: ProposedLabel | None, shown_picture: ShownPicture
) -> Label | None:
    """The label with another state; None where that state needs a position and none is known."""
    if state is LabelState.NO_BALL:
        return Label(t_us=shown_picture.t_us, state=state, provenance=shown_picture.provenance(PositionSource.BY_HAND))
    known = before if before is not None and before.x_px is not None else None
    if known is not None and shown_picture.over:
        return replace(known, state=state, provenance=shown_picture.provenance(PositionSource.SETTLED))
    if known is not None:
        return replace(known, state=state)
    if draft is not None and state is not LabelState.OUT_OF_FRAME:
        return replace(accepted(draft, shown_picture), state=state)
    if state.seen:
        return None
    return Label(t_us=shown_picture.t_us, state=state, provenance=shown_picture.provenance(PositionSource.BY_HAND))


def copied(label: Label, shown_picture: ShownPicture) -> Label:
    """The same ball at another time, for a hand to correct."""
    return replace(
        label, t_us=shown_picture.t_us, covariance_px2=None, provenance=shown_picture.provenance(PositionSource.BY_HAND)
    )


def _source_by_hand(
    x_px: float, y_px: float, label: Label | None, draft: ProposedLabel | None
) -> tuple[PositionSource, str]:
    """Moved by hand: a correction if a detector had proposed it, and it lies where the detector said, or nearly so."""
    if draft is not None and label is None:
        return PositionSource.CORRECTED, draft.detector
    proposed = label is not None and label.provenance.source in (PositionSource.ACCEPTED, PositionSource.CORRECTED)
    if label is not None and proposed and _means(x_px, y_px, label):
        return PositionSource.CORRECTED, label.provenance.detector
    return PositionSource.BY_HAND, ""


def _means(x_px: float, y_px: float, ball: Label | ProposedLabel) -> bool:
    """Whether a point lies within a ball, and so can be a better centre of it, or is another thing's."""
    if ball.x_px is None or ball.y_px is None:
        return False
    return math.hypot(x_px - ball.x_px, y_px - ball.y_px) <= max(ball.r_px or 0.0, MIN_REACH_PX)
