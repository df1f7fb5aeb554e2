"""`rallyscope labels shift`: by how much labels are shifted from the events, in time and in pixels."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from app.cli.arguments import flag
from app.cli.detector_arguments import DetectorArguments
from app.cli.labels_layer import LayerArguments, read_layer
from app.cli.progress import progress_bar
from app.modes.label.sources import LabelSource
from core.detection import make_detector
from core.errors import CommandError
from core.metrics import run_detector
from core.text import counted
from labels.assist.label_shift import LabelShift, find_label_shift
from labels.model import Label
from labels.store import AnyLabel, LabelStore


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelShiftArguments:
    """Measure by how much labels are shifted, in time and in pixels, from what a detector finds in the events."""

    layer: LayerArguments
    detector: DetectorArguments
    apply: bool = flag("store the moved labels as those of an annotator NAME-shifted")


def run_shift(arguments: LabelShiftArguments) -> None:
    """Measure, and move the labels if that is asked for."""
    layer = arguments.layer
    method, config, window_us = arguments.detector.settings()
    with layer.open() as (recording, stream):
        if isinstance(stream, LabelSource):
            raise CommandError("pictures have no events to compare with", got=stream.name, where="--camera")
        store = read_layer(layer, recording, stream)
        labels = store.labels()
        labels = labels.rows(labels.seen)
        with progress_bar("Detecting") as progress:
            detector = make_detector(method, stream.sensor, config)
            answers = run_detector(stream, detector, window_us, progress=progress)
        found = answers.rows(answers.detected)
        placed, seen = (np.stack(pair, axis=1) for pair in ((labels.x_px, labels.y_px), (found.u_px, found.v_px)))
        shift = find_label_shift(labels.t_us, placed, found.t_us, seen)
        lines = _shift_lines(shift)
        report: dict[str, object] = {**dataclasses.asdict(shift), "is_zero": shift.is_zero, "applied_as": None}
        if arguments.apply:
            if not shift.found:
                raise CommandError("no shift was found to apply", got=shift.reason)
            # Under another name: what a person placed stays as it is.
            name = f"{store.layer.annotator}-shifted"
            every, contacts = store.all(), store.contacts()
            moved = [one for label in every if (one := _moved(label, shift)) is not None]
            moved_contacts = [one for contact in contacts if (one := _at_other_time(contact, shift)) is not None]
            tool = f"rallyscope {version('rallyscope')}"
            with LabelStore.open(layer.folder, recording.uuid, stream.name, name, tool=tool) as target:
                if len(target.labels()) or target.contacts():
                    raise CommandError("there are moved labels already", got=name, where="--apply")
                target.edit(put=moved, put_contacts=moved_contacts)
            report["applied_as"] = name
            what = counted(len(moved), "label") + (f", {counted(len(contacts), 'contact')}" if contacts else "")
            lines.append(f"{what} moved, stored as {name!r}")
            if lost := len(every) - len(moved) + len(contacts) - len(moved_contacts):
                lines.append(f"{lost} left out: before the start of the recording")
    layer.tell(report, lines)


def _moved(label: Label, shift: LabelShift) -> Label | None:
    """A label at the time and place of the events; None before the start of the recording."""
    at = _at_other_time(label, shift)
    if at is None or at.x_px is None or at.y_px is None:
        return at
    return dataclasses.replace(at, x_px=at.x_px + shift.du_px, y_px=at.y_px + shift.dv_px)


def _at_other_time(one: AnyLabel, shift: LabelShift) -> AnyLabel | None:
    """A label or a contact at the time of the events; None before the start of the recording."""
    t_us, made = one.t_us + round(shift.dt_us), one.provenance
    if made.window_us is not None:
        start_us, end_us = (at_us + round(shift.dt_us) for at_us in made.window_us)
        made = dataclasses.replace(made, window_us=(start_us, end_us))
    return None if t_us < 0 else dataclasses.replace(one, t_us=t_us, provenance=made)


def _shift_lines(shift: LabelShift) -> list[str]:
    if not shift.found:
        return [f"no shift found: {shift.reason}"]
    measured = (
        f"{shift.dt_us / 1000:+.2f} ms (+-{shift.sigma_us / 1000:.2f}), "
        f"{shift.du_px:+.2f} {shift.dv_px:+.2f} px (+-{shift.sigma_px:.2f}), "
        f"confidence {shift.confidence:.2f}, {counted(shift.answers, 'detection')}"
    )
    if shift.is_zero:
        return [f"the labels fit the events: {measured}"]
    return [f"move the labels by {measured}", "--apply stores the moved labels beside these"]
