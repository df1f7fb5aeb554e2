"""Reads labels of another tool and looks at them as a whole: what no reader can see in a single entry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from core.errors import LabelError, RecordingError
from core.events import SensorSize
from core.recordings import Recording
from labels.formats.exchange import (
    FORMATS,
    HALF_PIXEL,
    ImportContext,
    Imported,
    Rejection,
    rejection_of,
)
from labels.formats.picture_times import FrameTimes
from labels.model import Label, LabelState

AFTER_END_US: Final = 100_000
"""Latest picture after the last event: a picture may still have been taken so much later."""
LOOKED_AT: Final = 100
NEAR_US: Final = 2_000
NEAR_PX: Final = 10.0
"""A ball's events lie so near to its centre in time and place."""
ENOUGH_EVENTS: Final = 50
CLEARLY_MORE: Final = 5
MANY_OUTSIDE: Final = 5
"""Centres outside the picture from which on the rest is looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportChoices:
    """What a person says of files that they do not say themselves."""

    times: FrameTimes = field(default_factory=FrameTimes)
    ball_class: str | None = None
    scale_pictures: bool = False
    picture_size: tuple[int, int] | None = None
    """Size of the pictures, where the files do not state it."""
    empty_is_no_ball: bool = False
    """Somebody looked at listed pictures without any annotation."""


def import_context(
    recording: Recording, camera: str, sensor: SensorSize, format_name: str, choices: ImportChoices
) -> ImportContext:
    """What files of labels are held against: the camera `camera` of a recording, and what is said of them."""
    stream = recording.cameras.get(camera)
    return ImportContext(
        sensor,
        choices.times.by_number_us,
        f"import {format_name}",
        camera,
        clock_us=int(getattr(stream, "t_offset_us", 0)),
        times_by_name=choices.times.by_name_us,
        ball_class=choices.ball_class,
        scale_pictures=choices.scale_pictures,
        picture_size=choices.picture_size,
        empty_pictures=LabelState.NO_BALL if choices.empty_is_no_ball else None,
        other_cameras=tuple(name for name in recording.cameras if name != camera),
        recording_uuid=recording.uuid,
        end_us=recording.duration_us,
        events_between=None if stream is None else stream.slice,
    )


def import_labels(format_name: str, path: Path, context: ImportContext) -> Imported:
    """The labels that a file or folder gives for a recording; everything else is rejected with its reason."""
    found = FORMATS[format_name].read(path, context)
    places = found.places if len(found.places) == len(found.labels) else ((path, 1),) * len(found.labels)
    kept: list[tuple[Label, tuple[Path, int]]] = []
    rejected: list[Rejection] = []
    whole = _problem_of_all(found, context)
    for label, place in zip(found.labels, places, strict=True):
        problem = (whole if label.x_px is not None else None) or _problem_of(label, context)
        if problem is None:
            kept.append((label, place))
        else:
            rejected.append(rejection_of(*place, problem))
    late = [contact for contact in found.contacts if _is_late(contact.t_us, context)]
    rejected += [rejection_of(path, 1, _late_error(contact.t_us, context)) for contact in late]
    return replace(
        found,
        contacts=tuple(contact for contact in found.contacts if contact not in late),
        labels=tuple(label for label, _ in kept),
        places=tuple(place for _, place in kept),
        rejections=(*found.rejections, *rejected),
        notes=(*found.notes, *_upside_down([label for label, _ in kept], context)),
    )


def _upside_down(labels: list[Label], context: ImportContext) -> list[str]:
    """A line if the events lie where the labels would be with rows counted from the bottom of the picture."""
    if context.events_between is None:
        return []
    seen = [(one.t_us, one.x_px, one.y_px) for one in labels if one.state.seen]
    here, there = 0, 0
    for t_us, x_px, y_px in seen[:: len(seen) // LOOKED_AT + 1]:
        if x_px is None or y_px is None:
            continue
        try:
            events = context.events_between(max(0, t_us - NEAR_US), t_us + NEAR_US)
        except RecordingError:  # damaged events are no reason to refuse labels
            return []
        rows = events.y_px[np.abs(events.x_px - x_px) < NEAR_PX].astype(np.float64)
        here += int(np.count_nonzero(np.abs(rows - y_px) < NEAR_PX))
        there += int(np.count_nonzero(np.abs(context.sensor.height_px - 1 - rows - y_px) < NEAR_PX))
    if there < ENOUGH_EVENTS or there < CLEARLY_MORE * here:
        return []
    counts = f"{there:,} events lie there, {here:,} at the labels"
    return [f"are the rows counted from the bottom of the picture? With y = height - 1 - y {counts}"]


def _problem_of(label: Label, context: ImportContext) -> LabelError | None:
    """Why one label cannot be of this recording."""
    if _is_late(label.t_us, context):
        return _late_error(label.t_us, context)
    if label.state.seen and label.x_px is not None and label.y_px is not None:
        width, height = context.sensor.width_px, context.sensor.height_px
        inside = -HALF_PIXEL <= label.x_px <= width - HALF_PIXEL and -HALF_PIXEL <= label.y_px <= height - HALF_PIXEL
        if not inside:
            got = f"({label.x_px:.1f}, {label.y_px:.1f})"
            return LabelError("the centre is outside the picture", expected=f"within {context.sensor}", got=got)
    return None


def _is_late(t_us: int, context: ImportContext) -> bool:
    return context.end_us is not None and t_us > context.end_us + AFTER_END_US


def _late_error(t_us: int, context: ImportContext) -> LabelError:
    remedy = "are the labels or the --frame-times those of another recording?"
    expected = f"0 to {context.end_us} us"
    return LabelError("the time lies after the recording", expected=expected, got=t_us, remedy=remedy)


def _problem_of_all(found: Imported, context: ImportContext) -> LabelError | None:
    """Why all positions together cannot be pixels of this sensor."""
    seen = [(label.x_px, label.y_px) for label in found.labels if label.x_px is not None and label.y_px is not None]
    outside = sum(rejection.kind == "the centre is outside the picture" for rejection in found.rejections)
    if outside >= MANY_OUTSIDE and outside > len(seen):
        got = f"{outside} of {outside + len(seen)} centres outside of {context.sensor}"
        remedy = "were pictures of another size or of another camera labelled?"
        return LabelError("most centres are outside the picture", got=got, remedy=remedy)
    near = [max(x, y) < 1 and min(x, y) > -1 for x, y in seen]
    if seen and all(near) and any(number % 1 not in (0, HALF_PIXEL) for place in seen for number in place):
        got = f"all {len(seen)} within a pixel of the corner"
        return LabelError("the positions are shares of the picture, where pixels belong", got=got)
    return None
