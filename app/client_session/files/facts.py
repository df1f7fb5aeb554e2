"""What the page is told of files. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from app.formatting.text import notice_of
from app.shared.files import OfferedFile
from app.web.pages import Json, Message
from core.errors import RallyscopeError
from core.recordings import Recording, knows_ball

MAX_LISTED: Final = 1_000
MAX_NOTES: Final = 8
LONGEST_NOTE: Final = 400


def list_message(files: Sequence[OfferedFile]) -> Message:
    """The list of the dialog; names and keys, no paths."""
    rows: list[Json] = [
        [file.key, file.path.name, file.folder, file.kind, size_text(file.size_bytes)] for file in files[:MAX_LISTED]
    ]
    return {"files": rows, "left_out": max(0, len(files) - MAX_LISTED)}


def facts_message(name: str, source: str, kind: str | None, recording: Recording) -> Message:
    """What was recognised in a file that is open now."""
    cameras: list[Json] = [
        f"{camera}: {stream.sensor}, {stream.event_count:,} events" for camera, stream in recording.cameras.items()
    ]
    said = [note[:LONGEST_NOTE] for note in recording.notes if not note.startswith("Imported from ")]
    notes: list[Json] = [*said[:MAX_NOTES], *([f"... and {len(said) - MAX_NOTES} more"] if said[MAX_NOTES:] else [])]
    facts: list[Json] = [*cameras, f"{recording.duration_us / 1e6:.3f} s", *_extras(recording)]
    return {"state": "done", "file": source, "name": name, "kind": kind or "", "facts": facts, "notes": notes}


def problem_message(source: str, path: Path, error: RallyscopeError) -> Message:
    """Why a file could not be opened, in one line; the file is called as the person calls it."""
    title, details = notice_of(error)
    details = details.replace(str(path), source).removeprefix(source).lstrip("; ")
    return {"state": "failed", "file": source, "problem": ": ".join(part for part in (title, details) if part)}


def size_text(size_bytes: int) -> str:
    """A size as people say it."""
    for unit, bytes_ in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= bytes_:
            return f"{size_bytes / bytes_:.{0 if size_bytes >= 10 * bytes_ else 1}f} {unit}"
    return f"{size_bytes} bytes"


def _extras(recording: Recording) -> list[Json]:
    known: list[Json] = []
    if any(stream.calibration is not None for stream in recording.cameras.values()):
        known.append("calibrated")
    if knows_ball(recording):
        known.append("knows the true ball")
    return known
