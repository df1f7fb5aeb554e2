"""A table from each of several recordings: made wherever the engine is, written here as soon as it is there."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.cli.backend_arguments import BackendArguments
from app.cli.files import table_paths, write_text
from app.cli.progress import progress_bar
from app.cli.terminal import say
from core.errors import RecordingError
from core.jobs import TaskControl, open_jobs

Summary = dict[str, object]


@dataclass(frozen=True, slots=True)
class RecordingTable:
    """What came of a recording."""

    text: str
    """The CSV."""
    summary: Summary
    """Plain values that say what is in it."""


def tabulate(
    recordings: Sequence[Path],
    out: Path,
    work: Callable[[Path, TaskControl], RecordingTable],
    engine: BackendArguments,
    title: str,
    as_json: bool,
    describe: Callable[[Summary], None],
) -> None:
    """Make the tables and write them, and say what came out: of one recording its summary, of several a list.

    Raises:
        RecordingError: if there is no such recording, before anything is done.
        CommandError: if the tables cannot be written.
        JobsError: if the engine fails.
    """
    several = len(recordings) > 1
    chosen, tables = engine.engine(), table_paths(recordings, out)
    for path in recordings:
        # Here, one alone is missed at once when it is opened, with a better message.
        if not path.exists() and (several or chosen.cluster):
            raise RecordingError("no such file", where=path)
    summaries: dict[int, Summary] = {}

    def write(number: int, table: RecordingTable) -> None:
        write_text(tables[number], table.text)
        about: Summary = {"recording": str(recordings[number]), "out": str(tables[number])}
        summaries[number] = about | table.summary

    with open_jobs(chosen, len(recordings)) as jobs, progress_bar(title) as progress:
        shared = [jobs.share_file(path) for path in recordings]
        jobs.run(work, shared, name=str, done=write, progress=progress)
    ordered = [summaries[number] for number in range(len(recordings))]
    if as_json:
        say(json.dumps({"recordings": ordered} if several else ordered[0]))
        return
    for summary in ordered:
        describe(summary)
