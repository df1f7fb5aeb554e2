"""Plain JSON: one file with every label and every contact of a camera, each with everything it says.

{"recording", "camera", "annotator", "labels": [{"t_us", "state", "x_px", ...}], "contacts": [{"t_us", "kind", ...}]};
pixel centres at whole numbers, times in microseconds, null where something says nothing.
"""

from __future__ import annotations

import json
from pathlib import Path

from core.files import file_stem
from labels.formats.coco import add_contacts
from labels.formats.documents import JsonObject, parse_json
from labels.formats.exchange import (
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    files_at,
    read_text,
    write_text,
)
from labels.formats.flat import COLUMNS, contact_row, flat_row, label_of_row


def write_json(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>.json` in the folder."""
    document = {
        "recording": labels.recording_uuid,
        "camera": labels.camera,
        "annotator": labels.annotator,
        "labels": [flat_row(label) for label in labels.labels],
        "contacts": [contact_row(contact) for contact in labels.contacts],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return Exported((write_text(folder / f"{file_stem(labels.camera)}.json", text),), ())


def read_json(path: Path, context: ImportContext) -> Imported:
    """Every JSON file of a folder, or one."""
    collector = Collector()
    for file in files_at(path, ".json", collector):
        text = read_text(file, collector)
        if text is not None:
            with collector.entry(file, 1):
                _read_document(parse_json(text), file, context, collector)
    return collector.done()


def _read_document(document: object, file: Path, context: ImportContext, collector: Collector) -> None:
    labels = document.get("labels") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(labels, list):
        collector.reject(file, 1, "not a file of labels; expected an object with the list labels")
        return
    if not collector.is_of(context, file, document.get("camera"), document.get("recording")):
        return
    for number, entry in enumerate(labels):
        if not isinstance(entry, JsonObject):
            collector.reject(file, 1, f"label {number} is not an object")
            continue
        with collector.entry(file, entry.line):
            texts = {name: str(entry[name]) for name in COLUMNS if entry.get(name) is not None}
            collector.add(label_of_row(texts, context.origin), file, entry.line)
    add_contacts(document.get("contacts"), file, context, collector)
