"""The facts of an event file as rows of a table: for `import --check` and for the app's Open file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from core.recordings.import_facts import IMPORTED_FROM, ImportFacts, SourceFacts
from core.recordings.sources.source import Whence

Row = tuple[str, str]
_WHENCE: Final[Mapping[str, str]] = {
    Whence.FORMAT: "as the format defines",
    Whence.FILE: "from the file",
    Whence.OPTION: "as given",
    Whence.CALIBRATION: "from the calibration beside it",
    Whence.CAMERA: "of the camera that the file names",
    Whence.DATA_SET: "assumed, of this data set",
    Whence.ASSUMED: "assumed",
}


def fact_rows(camera: SourceFacts, *, complete: bool = True) -> list[Row]:
    """What each fact is called, and its value with where it is from."""
    counted = f"{camera.events:,}" + ("" if complete else " in the part that was looked at")
    extras = [
        f"{count:,} {what}" for count, what in ((camera.triggers, "trigger edges"), (camera.pictures, "pictures"))
        if count
    ]  # fmt: skip
    lasted = "none"
    if camera.first_us is not None and camera.last_us is not None:
        lasted = f"{camera.first_us:,} us to {camera.last_us:,} us on its own clock"
    calibration = "none" if camera.calibration_from is None else _whence(camera.calibration_from)
    return [
        ("format", camera.format),
        ("sensor", f"{camera.width_px}x{camera.height_px}, {_whence(camera.sensor_from)}"),
        ("time unit", f"{camera.time_unit}, {_whence(camera.time_unit_from)}"),
        ("polarity", f"{camera.polarity}, {_whence(camera.polarity_from)}"),
        ("events", ", ".join([f"{counted}: {camera.on_events:,} ON, {camera.off_events:,} OFF", *extras])),
        ("first, last", lasted),
        ("calibration", calibration),
        ("left out", _counted(camera.left_out) if complete else "known after the import"),
        ("put right", _counted(camera.changed) if complete else "known after the import"),
    ]


def check_lines(facts: ImportFacts) -> list[str]:
    """What `import --check` prints: each camera, what is assumed, and the other notes."""
    lines: list[str] = []
    for camera in facts.cameras:
        lines.append(f"{camera.file}, camera {camera.name}")
        lines += [f"  {label:<12} {value}" for label, value in fact_rows(camera, complete=facts.complete)]
    lines.append(f"duration     {facts.duration_us / 1e6:.6f} s")
    lines += [f"assumed:     {line}" for line in facts.assumed] or ["assumed:     nothing"]
    others = [note for note in facts.notes if note not in facts.assumed and not note.startswith(IMPORTED_FROM)]
    return lines + [f"note:        {note}" for note in others]


def _whence(word: str) -> str:
    return _WHENCE.get(word, word)


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {what}" for what, count in counts.items()) or "nothing"
