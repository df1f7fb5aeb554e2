"""Make a data set in parallel: many processes, each making one recording at a time on one thread."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.data_sets.card import read_manifest, write_card
from core.data_sets.facts import (
    RecordingFacts,
    file_sha256,
    make_recording,
    read_facts,
    recording_path,
    remove_partials,
)
from core.data_sets.plan import DataSetPlan, PlannedRecording
from core.errors import RecordingError
from core.extras import require_package
from core.files import hold
from core.jobs import ALONE, HERE, JobBackend, TaskControl, open_jobs

LOCK: Final = ".data-set.lock"
CARD_SHARE: Final = 0.05
"""Share of the time that may go into the card: with thousands of recordings it is not written after each."""
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class DataSetRun:
    """What a run did."""

    folder: Path
    made: tuple[str, ...]
    """Names of the recordings that it made."""
    kept: tuple[str, ...]
    """Those that were there."""
    manifest: dict[str, object]


def run_data_set(
    plan: DataSetPlan,
    folder: Path,
    *,
    engine: JobBackend = HERE,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
) -> DataSetRun:
    """Make the recordings of the plan that are not there yet, and keep the card up to date.

    What is there stays, if it was made with the same settings. The recordings do not depend on the `engine` that makes
    them; all of it has to see the folder. Ending this process, however it is done, ends the work, and no unfinished
    recording has a final name.

    Raises:
        RecordingError: if a recording there has other settings, another run works in the folder, or writing fails.
        ConfigError: if a serve is impossible.
        PackageError: without pyarrow.
        JobsError: if a cluster cannot be used, or the workers of a recording keep dying.
    """
    require_package("pyarrow", "the index of a data set")  # now: it is written after the recordings
    with _locked(folder), _errors_in_one_line(folder):
        remove_partials(folder)
        facts: dict[str, RecordingFacts] = {}
        digests = _known_digests(folder)
        for planned in plan.recordings:
            path = recording_path(folder, planned)
            if path.exists() and not overwrite:
                known = digests.get((planned.uuid, path.stat().st_size), "")
                facts[planned.name] = read_facts(path, planned, known)
        kept = tuple(facts)
        missing = [planned for planned in plan.recordings if planned.name not in facts]
        card = _CardKeeper(folder, plan, facts)
        card.write()

        def done(number: int, sha256: str) -> None:
            planned = missing[number]
            facts[planned.name] = read_facts(recording_path(folder, planned), planned, sha256)
            card.write_if_due()

        try:
            with open_jobs(engine if missing else ALONE, len(missing)) as jobs:
                work = MakeTask(jobs.share_folder(folder))
                jobs.run(work, missing, name=_name, done=done, progress=progress)
        finally:
            remove_partials(folder)
            manifest = card.write()
        return DataSetRun(folder, tuple(planned.name for planned in missing), kept, manifest)


class _CardKeeper:
    """Writes the card of what is there, seldom enough."""

    def __init__(self, folder: Path, plan: DataSetPlan, facts: dict[str, RecordingFacts]) -> None:
        self._folder, self._plan, self._facts = folder, plan, facts
        self._due_s = 0.0

    def write(self) -> dict[str, object]:
        """Returns the manifest."""
        began_s = time.monotonic()
        manifest = write_card(self._folder, self._plan, self._facts)
        ended_s = time.monotonic()
        self._due_s = ended_s + (ended_s - began_s) / CARD_SHARE
        return manifest

    def write_if_due(self) -> None:
        """Unless it would take more than its share of the time."""
        if time.monotonic() >= self._due_s:
            self.write()


def _known_digests(folder: Path) -> dict[tuple[str, int], str]:
    """By uuid and size, from the manifest of an earlier run; without a whole one they are computed again."""
    with suppress(RecordingError):
        entries = read_manifest(folder)["recordings"]
        assert isinstance(entries, list)
        known = {(str(one.get("uuid")), one["bytes"]): str(one.get("sha256")) for one in entries}
        return {key: sha256 for key, sha256 in known.items() if re.fullmatch("[0-9a-f]{64}", sha256)}
    return {}


def _name(planned: PlannedRecording) -> str:
    return planned.name


@contextmanager
def _errors_in_one_line(folder: Path) -> Iterator[None]:
    """A disk that refuses something, here or in a worker, is no bug."""
    try:
        yield
    except OSError as error:
        remedy = "free some space and run it again; what is done stays"
        got = error.strerror or error
        raise RecordingError("the data set cannot be written", got=got, where=folder, remedy=remedy) from error


def _locked(folder: Path) -> AbstractContextManager[object]:
    """The folder, made if need be, for this run alone."""
    try:
        return hold(folder / LOCK)
    except TimeoutError as error:
        raise RecordingError("another run is making this data set", where=folder, remedy="wait for its end") from error
    except OSError as error:
        raise RecordingError("cannot make the data set's folder", got=error.strerror, where=folder) from error


@dataclass(frozen=True, slots=True)
class MakeTask:
    """Makes a recording of the data set in a folder."""

    folder: Path

    def __call__(self, planned: PlannedRecording, control: TaskControl) -> str:
        """Simulate it on one thread; returns the file's digest."""
        make_recording(planned, self.folder, control)
        return file_sha256(recording_path(self.folder, planned))
