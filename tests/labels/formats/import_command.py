"""The command as a user runs it: files of a tool are imported, and what was taken is exported as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.cli.main import main
from core.events import Events, SensorSize
from core.recordings import RecordingWriter

SENSOR = SensorSize(1280, 720)
TIMES = "t_us\n" + "".join(f"{10_000 * k}\n" for k in range(100))
Row = tuple[int, str, float | None, float | None]


@dataclass(frozen=True)
class Outcome:
    """What came of an import."""

    code: int
    error: str
    rows: list[Row]
    """Time, state and centre of every label, by time."""
    reasons: dict[str, int]
    """Rejections by reason."""
    rejected: list[str]
    notes: list[str]
    radii: list[float | None]
    sources: list[str]

    @property
    def times(self) -> list[int]:
        """When there are labels."""
        return [row[0] for row in self.rows]

    @property
    def said(self) -> str:
        """Everything that a user reads of what was not taken, and of what was noted."""
        return "\n".join([self.error, *self.rejected, *self.notes])


@dataclass(frozen=True)
class Report:
    """A public report of somebody with a file of labels, an input that we made after it, and what has to come of it."""

    link: str
    before: str
    """What an import did when the report was first tried."""
    kind: str
    files: Mapping[str, str | bytes]
    rows: list[Row] = field(default_factory=list)
    says: str = ""
    flags: tuple[str, ...] = ()
    times: str = TIMES


def make_recording(path: Path, cameras: Sequence[str] = ("camera",)) -> Path:
    """A second of a few events."""
    t_us = np.arange(0, 1_000_000, 1000)
    events = Events.from_columns(t_us, t_us % 1280, t_us % 720, t_us % 2 == 0, SENSOR)
    with RecordingWriter(path, dict.fromkeys(cameras, SENSOR), uuid="11111111-2222-4333-8444-555555555555") as writer:
        for camera in cameras:
            writer.append(camera, events)
    return path


def import_files(
    folder: Path,
    kind: str,
    files: Mapping[str, str | bytes],
    *flags: str,
    source: str = ".",
    times: str | None = TIMES,
    cameras: Sequence[str] = ("camera",),
) -> Outcome:
    """Write the files into a folder, import them or the part `source` of them, and export the labels as CSV."""
    root = folder / "files"
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    recording = make_recording(folder / "rec.h5", cameras)
    common = [str(recording), "--camera", cameras[0], "--data", str(folder / "data"), "--json"]
    words = ["labels", "import", str(root / source), *common, "--format", kind, "--annotator", "a", *flags]
    if times is not None:
        (folder / "times.csv").write_text(times, encoding="utf-8")
        words += ["--frame-times", str(folder / "times.csv")]
    code, out, error = _run(words)
    if code != 0:
        return Outcome(code, error, [], {}, [], [], [], [])
    report = json.loads(out)
    exported = folder / "csv"
    assert _run(["labels", "export", *common, "--format", "csv", "--out", str(exported)])[0] == 0
    (table,) = exported.glob("*.csv")
    rows = list(csv.DictReader(io.StringIO(table.read_text(encoding="utf-8"))))
    assert len(rows) == report["taken"] == report["imported"]
    return Outcome(
        code,
        error,
        [(int(row["t_us"]), row["state"], _number(row["x_px"]), _number(row["y_px"])) for row in rows],
        {item["reason"]: item["count"] for item in report["rejected_by_reason"]},
        report["rejected"],
        report["notes"],
        [_number(row["r_px"]) for row in rows],
        [row["source"] for row in rows],
    )


def _run(words: list[str]) -> tuple[int, str, str]:
    out, error = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(error):
        code = main(words)
    return code, out.getvalue(), error.getvalue()


def _number(text: str) -> float | None:
    return round(float(text), 3) if text else None
