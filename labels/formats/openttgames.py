"""OpenTTGames markup: the ball of each marked picture of a clip, and its bounces and touches of the net, by picture.

`ball_markup.json` is {"14": {"x": 512, "y": 300}, ...}: number of the picture from 0 and pixel of the original size, -1
and -1 where no ball is seen; pictures that are not in it were not looked at. `events_markup.json` is {"17": "bounce",
...}, with "net" and "empty_event", where nothing happens (https://lab.osai.ai/datasets/openttgames). It has no word for
a hit. `frames.csv` beside them, which is ours, holds the time of each number.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from core.errors import LabelError
from core.files import file_stem
from labels.formats.documents import JsonObject, parse_json
from labels.formats.exchange import (
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    count_losses,
    files_at,
    finite,
    read_text,
    whole_number,
    write_text,
)
from labels.formats.labelled_pictures import SamePictures
from labels.formats.tracknet import FRAMES, read_frame_times, write_frame_times
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource, Provenance

BALL, EVENTS = "ball_markup.json", "events_markup.json"
NOTHING: Final = "empty_event"
KINDS: Final = {str(kind): kind for kind in (ContactKind.BOUNCE, ContactKind.NET)}


def write_openttgames(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`ball_markup.json`, `events_markup.json` and `frames.csv` in a folder of the camera's name.

    A picture is the time of a label, or of a contact.
    """
    contacts = [contact for contact in labels.contacts if str(contact.kind) in KINDS]
    losses = ["provenance, covariance and radius"] * bool(labels.labels)
    losses += ["a hit, which OpenTTGames has no word for"] * (len(labels.contacts) - len(contacts))
    losses += ["provenance and uncertainty of a contact"] * len(contacts)
    times = sorted({one.t_us for one in (*labels.labels, *contacts)})
    numbers = {t_us: number for number, t_us in enumerate(times)}
    balls = []
    for label in labels.labels:
        losses += [f"state {label.state}"] if label.state not in (LabelState.VISIBLE, LabelState.NO_BALL) else []
        x, y = _position(label, options, losses)
        balls.append(f'"{numbers[label.t_us]}": {{"x": {x}, "y": {y}}}')
    events = [f'"{numbers[contact.t_us]}": "{contact.kind}"' for contact in contacts]
    own = folder / file_stem(labels.camera)
    files = (
        write_text(own / BALL, _object_text(balls)),
        write_text(own / EVENTS, _object_text(events)),
        write_frame_times(own, times),
    )
    return Exported(files, count_losses(losses))


def _position(label: Label, options: ExportOptions, losses: list[str]) -> tuple[str, str]:
    if not label.state.seen or label.x_px is None or label.y_px is None:
        return "-1", "-1"
    if not options.whole_pixels:
        return f"{label.x_px:.3f}", f"{label.y_px:.3f}"
    losses.append("position rounded to whole pixels")
    # Halves always up, as in tracknet.py: a bias that does not depend on the pixel.
    return f"{np.floor(label.x_px + 0.5):.0f}", f"{np.floor(label.y_px + 0.5):.0f}"


def _object_text(entries: list[str]) -> str:
    return "{\n" + ",\n".join(f" {entry}" for entry in entries) + "\n}\n"


def read_openttgames(path: Path, context: ImportContext) -> Imported:
    """Every JSON file of a folder, or one; times come from `frames.csv` beside it, else from the context."""
    collector, same = Collector(), SamePictures()
    documents: list[tuple[Path, JsonObject]] = []
    for file in files_at(path, ".json", collector):
        text = read_text(file, collector)
        if text is None:
            continue
        with collector.entry(file, 1):
            document = parse_json(text)
            if not isinstance(document, JsonObject):
                raise LabelError("not a file of OpenTTGames; expected an object with an entry for each picture")
            if document.repeated:
                collector.reject(file, 1, "a picture is in it twice; the last entry is kept")
            documents.append((file, document))
            if any(isinstance(entry, JsonObject) for entry in document.values()):
                same.add(file, list(document))
    times: dict[Path, dict[int, int] | None] = {}
    for file, document in documents:
        beside = file.parent / FRAMES
        if beside not in times:
            times[beside] = read_frame_times(beside, collector) if beside.is_file() else None
        if same.accept(file, collector):
            _read_document(document, file, times[beside], context, collector)
    return collector.done()


def _read_document(
    document: JsonObject, file: Path, times: dict[int, int] | None, context: ImportContext, collector: Collector
) -> None:
    for key, entry in document.items():
        with collector.entry(file, entry.line if isinstance(entry, JsonObject) else 1):
            number = whole_number(key, "the number of a picture")
            if times is not None and number not in times:
                raise LabelError(f"picture {number} is not in {FRAMES}")
            t_us = context.time_of_frame(number) if times is None else times[number]
            if isinstance(entry, JsonObject):
                collector.add(_label_of(entry, t_us, context), file, entry.line)
            elif entry in KINDS:
                made = Provenance(source=PositionSource.IMPORTED, detector=context.origin)
                collector.add_contact(ContactLabel(t_us=t_us, kind=KINDS[str(entry)], provenance=made), file, 1)
            elif entry != NOTHING:
                expected = ", ".join((*KINDS, NOTHING))
                raise LabelError("unknown event", expected=expected, got=repr(entry)[:80])


def _label_of(entry: JsonObject, t_us: int, context: ImportContext) -> Label:
    x, y = finite(entry["x"], "x"), finite(entry["y"], "y")
    if x < 0 and y < 0:
        return context.make(t_us, LabelState.NO_BALL)
    across, down = context.stated_factors
    x, y = (x + HALF_PIXEL) * across - HALF_PIXEL, (y + HALF_PIXEL) * down - HALF_PIXEL
    return context.ball(t_us, LabelState.VISIBLE, x, y, None)
