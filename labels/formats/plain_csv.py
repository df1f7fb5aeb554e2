"""Plain CSV: one row a label with everything it says, pixel centres at whole numbers, times in microseconds."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from core.errors import LabelError
from labels.formats.deeplabcut import is_deeplabcut, read_deeplabcut
from labels.formats.exchange import (
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    files_at,
    picture_name,
    read_text,
    table_rows,
    write_text,
)
from labels.formats.flat import COLUMNS, REQUIRED, flat_row, label_of_row
from labels.formats.track import read_track, track_columns


def write_csv(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>.csv` in the folder."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(COLUMNS), lineterminator="\n")
    writer.writeheader()
    for label in labels.labels:
        writer.writerow({name: "" if value is None else value for name, value in flat_row(label).items()})
    name = picture_name(labels.camera, 0).rsplit("_t", 1)[0]
    return Exported((write_text(folder / f"{name}.csv", text.getvalue()),), ())


def read_csv(path: Path, context: ImportContext) -> Imported:
    """Every CSV file of a folder, or one. Columns are found by their names; unknown ones are refused.

    A table without states is a 2D track of another tool if it has the columns of one.
    """
    collector = Collector()
    for file in files_at(path, ".csv", collector):
        text = read_text(file, collector)
        if text is not None:
            _read_file(text, file, context, collector)
    return collector.done()


def _read_file(text: str, file: Path, context: ImportContext, collector: Collector) -> None:
    rows = table_rows(text, file, collector)
    _, names = next(rows, (1, []))
    header = [name.strip() for name in names]
    if is_deeplabcut(header):
        read_deeplabcut(header, rows, file, context, collector)
        return
    if "state" not in header and (columns := track_columns([name.lower() for name in header])) is not None:
        read_track(list(rows), columns, file, context, collector)
        return
    unknown, missing = [name for name in header if name not in COLUMNS], set(REQUIRED) - set(header)
    if unknown or missing or len(set(header)) != len(header):
        found = ", ".join(header)[:200]
        collector.reject(file, 1, f"not a label table; expected columns {', '.join(REQUIRED)}, ..., got {found}")
        return
    for line, fields in rows:
        with collector.entry(file, line):
            if len(fields) != len(header):
                raise LabelError("wrong number of fields", expected=len(header), got=len(fields))
            row = dict(zip(header, (field.strip() for field in fields), strict=True))
            collector.add(label_of_row(row, context.origin), file, line)
