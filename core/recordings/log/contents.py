"""What a log holds, by where it lies in it, and what a damaged one has lost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

from core.errors import RecordingError
from core.recordings.blocks import CHUNK_EVENTS
from core.recordings.log.growing import Json
from core.recordings.log.scanning import Frame, LogGap, scan, scan_damaged
from core.text import counted


@dataclass(frozen=True, slots=True)
class EventBlock:
    """Events of one camera, packed column by column."""

    start: int
    """How many events of the camera the writer had written before."""
    count: int
    offset: int
    """In the log."""
    sizes: tuple[int, ...]
    """Size of each packed column, bytes."""


@dataclass(slots=True)
class LogContents:
    """All frames of a log by what they are; blocks and rows are in the order of their times."""

    start: dict[str, Json]
    blocks: dict[str, list[EventBlock]]
    """Per camera."""
    rows: dict[str, list[Frame]]
    """Per group."""
    notes: list[str] = field(default_factory=list)
    duration_us: int = 0
    end: int = 0
    """End of the last whole frame, bytes from the start."""
    gaps: list[LogGap] = field(default_factory=list)
    lost: dict[str, int] = field(default_factory=dict)
    """Events of a camera, or rows of a group, that lie in the gaps: as many as what follows them tells of."""

    @property
    def damaged(self) -> bool:
        """Whether more is wrong than an end that a kill has cut short."""
        return any(not gap.unfinished for gap in self.gaps)


def read_contents(log: BinaryIO, path: Path, *, check: bool) -> LogContents:
    """Look through a log: with `check` by its checksums, and on behind whatever is damaged.

    Raises:
        RecordingError: if no whole frame says what is recorded.
    """
    frames: list[Frame] = []
    gaps: list[LogGap] = []
    for part in scan_damaged(log) if check else scan(log):
        if isinstance(part, Frame):
            frames.append(part)
        else:
            gaps.append(part)
    # The first of several: the writer repeats it against damage.
    start = next((frame for frame in frames if frame.meta["kind"] == "start"), None)
    if start is None and frames:
        raise RecordingError(
            "the log of this recording lost what says which cameras are in it",
            got=f"{len(frames)} whole frames after it",
            where=path,
            remedy="keep the file, and restore it from a copy if there is one",
        )
    if start is None:
        raise RecordingError(
            "the recording was stopped before it began", where=path, remedy="delete it and record again"
        )
    cameras = cast("dict[str, Json]", start.meta["cameras"])
    contents = LogContents(start.meta, {name: [] for name in cameras}, {}, gaps=gaps)
    for frame in frames:
        contents.end = frame.offset + frame.size
        match frame.meta["kind"]:
            case "events":
                contents.blocks[cast(str, frame.meta["camera"])].append(_block(frame))
            case "rows":
                contents.rows.setdefault(cast(str, frame.meta["group"]), []).append(frame)
            case "note":
                contents.notes.append(cast(str, frame.meta["text"]))
            case "duration":
                contents.duration_us = cast(int, frame.meta["duration_us"])
    _settle(contents)
    return contents


def recovery_notes(contents: LogContents, size: int) -> list[str]:
    """What was recovered from a log of so many bytes, and what was not."""
    events = sum(block.count for blocks in contents.blocks.values() for block in blocks)
    cut = sum(gap.end - gap.begin for gap in contents.gaps if gap.unfinished)
    tail = f"; {cut} bytes of an unfinished block at the end were dropped" if cut else ""
    notes = [f"Its writer was stopped before it closed the recording: {events:,} events were recovered{tail}."]
    damaged = [gap for gap in contents.gaps if not gap.unfinished]
    if damaged:
        count = sum(gap.end - gap.begin for gap in damaged)
        where = counted(len(damaged), "place")
        parts = [f"{lost:,} {what}" for what, lost in _lost_words(contents)]
        if damaged[-1].end == size:
            parts.append("what the last of them held, if anything")
        words = " and ".join(parts) or "no events and no rows"
        notes.append(f"Its log was damaged in {where} ({count:,} bytes). Lost: {words}; all that follows was kept.")
    return notes


def _lost_words(contents: LogContents) -> Iterable[tuple[str, int]]:
    for name, lost in contents.lost.items():
        if lost:
            yield (f"events of {name}" if name in contents.blocks else f"rows of {name}"), lost


def _block(frame: Frame) -> EventBlock:
    meta = frame.meta
    sizes = tuple(cast("list[int]", meta["sizes"]))
    return EventBlock(cast(int, meta["start"]), cast(int, meta["count"]), frame.offset, sizes)


def _settle(contents: LogContents) -> None:
    """The longest state of each block in the order of writing, and how much is missing."""
    for camera, blocks in contents.blocks.items():
        longest: dict[int, EventBlock] = {}
        for block in blocks:
            number = block.start // CHUNK_EVENTS
            if number not in longest or block.count >= longest[number].count:
                longest[number] = block
        kept = [longest[number] for number in sorted(longest)]
        contents.blocks[camera] = kept
        written = kept[-1].start + kept[-1].count if kept else 0
        contents.lost[camera] = written - sum(block.count for block in kept)
    for group, frames in contents.rows.items():
        if all("start" in frame.meta for frame in frames):  # logs of earlier versions do not say it
            contents.rows[group] = _rows_in_order(frames)
            last = contents.rows[group][-1].meta
            written = cast(int, last["start"]) + cast(int, last["count"])
            contents.lost[group] = written - sum(cast(int, frame.meta["count"]) for frame in contents.rows[group])


def _rows_in_order(frames: list[Frame]) -> list[Frame]:
    ordered = {cast(int, frame.meta["start"]): frame for frame in frames}
    return [ordered[start] for start in sorted(ordered)]
