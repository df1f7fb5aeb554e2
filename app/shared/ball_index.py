"""The balls of all recordings, data sets and runs of a workspace, indexed anew when a source changes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.data_sets import MANIFEST
from core.errors import LabelError, RallyscopeError
from core.extras import require_package
from core.learning.runs.run_files import seed_files, seeds_of
from core.recordings import open_recording
from labels.contacts import MATCH_US
from labels.store_contents import read_store

if TYPE_CHECKING:
    import pyarrow as pa

CACHE: Final = "cache/balls"
"""Folder of a workspace for what is derived; it can be removed at any time."""
SourceKind = Literal["recording", "data set", "run"]


@dataclass(frozen=True, slots=True)
class BallSource:
    """One recording, or one seed of a training run."""

    kind: SourceKind
    name: str
    """Name of the recording's file without its ending, or `RUN/seed-N`."""
    path: Path
    """The recording, or the run's folder."""
    seed: int = 0

    @property
    def changes(self) -> Path:
        """The file whose size and time of change say whether the rows are still right."""
        return seed_files(self.path, self.seed).metrics if self.kind == "run" else self.path


@dataclass(frozen=True, slots=True, eq=False)
class BallIndex:
    """What was found, as it was when it was read."""

    table: pa.Table
    """Columns as in `labels.balls.table.COLUMNS`, in the order of the sources."""
    sources: tuple[BallSource, ...]
    first_rows: NDArray[np.int64]
    """(S + 1,) first row of each source, and the number of rows."""
    unknown: tuple[BallSource, ...] = ()
    """Recordings that say nothing of their balls: only the tracker can find them."""
    failed: dict[str, str] = field(default_factory=dict)
    """Why a source cannot be read, by its path."""
    made: int = 0
    """Sources that were indexed now; the others were stored."""

    def source_of(self, row: int) -> BallSource:
        """Where a row is from."""
        return self.sources[int(np.searchsorted(self.first_rows, row, side="right")) - 1]


def moved_rows(rows: NDArray[np.int64], before: BallIndex, after: BallIndex) -> NDArray[np.int64] | None:
    """Rows of one index in a later one, ascending; those of sources that changed are gone. None: nothing is left."""

    def spans(index: BallIndex) -> dict[BallSource, tuple[int, int]]:
        return {
            one: (int(a), int(b))
            for one, a, b in zip(index.sources, index.first_rows, index.first_rows[1:], strict=False)
        }

    later, found = spans(after), [np.zeros(0, np.int64)]
    for source, (first, end) in spans(before).items():
        if source in later and later[source][1] - later[source][0] == end - first:
            found.append(rows[(rows >= first) & (rows < end)] - first + later[source][0])
    moved = np.sort(np.concatenate(found))
    return moved if len(moved) else None


def ball_sources(place: Path, others: Iterable[Path] = ()) -> tuple[BallSource, ...]:
    """The recordings and runs in a workspace, or in any folder; a recording or a run alone.

    Args:
        place: a workspace, a data set, a folder of recordings, a recording or a run.
        others: more folders with recordings.
    """
    if place.is_file():
        return (BallSource("recording", place.stem, place),)
    if (place / "config.toml").is_file():
        return _seeds(place)
    folders = [place / "recordings", place, *others]
    folders += [one.parent for folder in folders for one in sorted(folder.glob(f"*/{MANIFEST}"))]
    found: dict[Path, BallSource] = {}
    for folder in folders:
        kind: SourceKind = "data set" if (folder / MANIFEST).is_file() else "recording"
        for path in sorted(folder.glob("*.h5")):
            if not path.name.startswith("."):
                found.setdefault(path.resolve(), BallSource(kind, path.stem, path))
    runs = [seed for run in sorted(place.glob("runs/*/config.toml")) for seed in _seeds(run.parent)]
    return (*found.values(), *runs)


def _seeds(run: Path) -> tuple[BallSource, ...]:
    paths = ((seed, seed_files(run, seed)) for seed in seeds_of(run))
    return tuple(BallSource("run", f"{run.name}/seed-{n}", run, n) for n, one in paths if one.metrics.is_file())


def index_balls(
    sources: Sequence[BallSource],
    workspace: Path | None = None,
    *,
    track: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> BallIndex:
    """The balls of these sources; those of a source that has not changed are read, and what cannot be read is noted.

    Args:
        sources: see `ball_sources`.
        workspace: where the rows are stored, and the labels are; None: nothing is stored, and no label is counted.
        track: let the tracker find the balls of recordings that say nothing of them; it takes long.
        progress: gets the share of the sources that is done.
        cancelled: looked at between sources and by the tracker; then the index holds what was found so far.

    Raises:
        PackageError: without pyarrow.
    """
    require_package("pyarrow", "the index of balls")
    from labels.balls.table import joined

    parts, found, unknown, failed, made = [], [], [], {}, 0
    for number, source in enumerate(sources):
        if cancelled():
            break

        def part(share: float, number: int = number) -> None:
            progress((number + share) / len(sources))

        try:
            table, uuid, is_known, is_new = _rows_of(source, workspace, track, part, cancelled)
        except (RallyscopeError, OSError) as error:
            failed[str(source.path)] = str(error)
            continue
        made += is_new
        unknown += [] if is_known else [source]
        labels = _count_labels(table, workspace, uuid)
        found.append(source)
        parts.append((source.kind, source.name, table, labels))
        part(1.0)
    first_rows = np.cumsum([0, *(len(table) for _, _, table, _ in parts)], dtype=np.int64)
    return BallIndex(joined(parts), tuple(found), first_rows, tuple(unknown), failed, made)


def _rows_of(
    source: BallSource,
    workspace: Path | None,
    track: bool,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> tuple[pa.Table, str, bool, bool]:
    """Rows, uuid, whether the source says anything of its balls, and whether the rows were made now."""
    from labels.balls.rows import rows_of_recording, rows_of_run
    from labels.balls.table import read_rows, stamp_of, table_of, write_rows
    from labels.balls.tracking import rows_of_track

    stored = None if workspace is None else workspace / CACHE / _cache_name(source)
    known = None if stored is None else read_rows(stored)
    if known is not None and known[1].same_file(source.changes):
        table, stamp = known
        if len(table) or stamp.tracked or not track:
            return table, stamp.uuid, bool(len(table)) or stamp.tracked, False
    stamp = stamp_of(source.changes)  # before it is read: what grows meanwhile is read again next time
    if source.kind == "run":
        rows, tracks = rows_of_run(source.path, source.seed, cancelled), False
    else:
        with closing(open_recording(source.path)) as recording:
            stamp = stamp_of(source.changes, recording.uuid)
            rows = rows_of_recording(recording)
            tracks = track and not rows
            if tracks:
                rows = rows_of_track(recording, progress=progress, cancelled=cancelled)
                stamp = stamp_of(source.changes, recording.uuid, tracked=True)
    table = table_of(rows)
    if stored is not None and not cancelled():  # half of a source is not kept
        write_rows(stored, table, stamp)
    return table, stamp.uuid, bool(rows) or tracks or source.kind == "run", True


def _cache_name(source: BallSource) -> str:
    place = f"{source.path.resolve()}\n{source.seed}".encode("utf-8", "surrogateescape")
    return f"{hashlib.sha256(place).hexdigest()[:24]}.parquet"


def _count_labels(table: pa.Table, workspace: Path | None, uuid: str) -> NDArray[np.int64]:
    """(N,) labels of the ball in each flight, and labelled contacts at each contact."""
    counts = np.zeros(len(table), np.int64)
    if workspace is None or not uuid or not len(table):
        return counts
    from labels.database.folder import store_path

    store = store_path(workspace / "labels", uuid)
    if not store.is_file():
        return counts
    with suppress(LabelError):  # a damaged store is reported where it is worked on
        contents = read_store(store)
        centres = np.sort([t_us for labels in contents.layers.values() for t_us in labels])
        contacts = np.sort([one.t_us for layer in contents.contacts.values() for one in layer])
        t_us = table.column("t_us").fill_null(-MATCH_US).to_numpy()
        end_us = table.column("end_us").fill_null(-1).to_numpy()
        in_flight = np.searchsorted(centres, end_us, side="right") - np.searchsorted(centres, t_us)
        near = np.searchsorted(contacts, t_us + MATCH_US) - np.searchsorted(contacts, t_us - MATCH_US, side="right")
        is_flight = np.array(table.column("kind").to_pylist()) == "flight"
        counts = np.where(is_flight, in_flight, near).clip(min=0).astype(np.int64)
    return counts
