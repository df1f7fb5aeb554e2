"""The user's folder: recordings, configs, runs, labels and exports.

A browser only ever sends names from lists that the server made, or new names, which become slugs here.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.detection.saved import SavedDetector, load_detector, save_detector
from core.errors import WRITE_REMEDY, CommandError, ConfigError
from core.files import begin_unfinished, claimed, end_unfinished, numbered, put_beside

LONGEST_SLUG: Final = 63
_SLUG = re.compile(rf"[a-z0-9][a-z0-9_-]{{0,{LONGEST_SLUG - 1}}}")


def slug_from(text: str) -> str:
    """A plain file name (without suffix) made of what a person typed.

    Raises:
        CommandError: if nothing was typed, or nothing usable is left.
    """
    if not text.strip():
        raise CommandError("a name is missing", remedy="type letters and digits")
    slug = re.sub(r"[^a-z0-9_-]+", "-", text.strip().lower()).strip("-_")[:LONGEST_SLUG].rstrip("-_")
    if not _SLUG.fullmatch(slug):
        raise CommandError("not a usable name", expected="letters and digits", got=repr(text[:80]))
    return slug


def _holds(path: Path, detector: SavedDetector) -> bool:
    try:
        return load_detector(path) == detector
    except ConfigError:
        return False


@contextmanager
def free_path(paths: Iterable[Path]) -> Iterator[Path]:
    """The first free path of an endless series, to be written within the `with` block; see `core.files.claimed`.

    Raises:
        CommandError: if the folder cannot be written.
    """
    try:
        with claimed(paths) as path:
            yield path
    except OSError as error:
        raise CommandError("cannot write", got=error.strerror, where=error.filename, remedy=WRITE_REMEDY) from error


def taken_text(wanted: str, path: Path) -> str:
    """What is said first of a file or folder that has not got the wanted name, as that was taken; else nothing."""
    return "" if path.stem == wanted else f"there is another {wanted} already, so this is {path.stem}; "


@dataclass(frozen=True, slots=True)
class Workspace:
    """Paths in the workspace folder; folders are made on first use."""

    root: Path

    @property
    def recordings(self) -> Path:
        """Folder of the recordings."""
        return self._folder("recordings")

    @property
    def configs(self) -> Path:
        """Folder of the detector configs."""
        return self._folder("configs")

    @property
    def runs(self) -> Path:
        """Folder of the trainings; each is a folder of its own."""
        return self._folder("runs")

    @property
    def labels(self) -> Path:
        """Folder of the labels, one layer per recording, camera and annotator."""
        return self._folder("labels")

    @property
    def exports(self) -> Path:
        """Folder of the exports."""
        return self._folder("exports")

    @property
    def data_sets(self) -> Path:
        """Folder of the data sets that were cut out of recordings."""
        return self._folder("data-sets")

    @property
    def samples(self) -> Path:
        """Folder for public sample files that a person has fetched."""
        return self._folder("samples")

    @property
    def browsers(self) -> Path:
        """Folder of the browsers' stored settings."""
        return self._folder("browsers")

    @property
    def biases_path(self) -> Path:
        """The biases of the event cameras, for `--biases`."""
        return self.cameras / "biases.toml"

    @property
    def cameras(self) -> Path:
        """Folder of the event cameras' biases and calibrations."""
        return self._folder("cameras")

    def run_path(self, name: str) -> Path:
        """Where the training of this name is or will be."""
        return self.runs / slug_from(name)

    def run_names(self) -> tuple[str, ...]:
        """Names of the trainings, unordered."""
        return tuple(path.parent.name for path in self.runs.glob("*/config.toml") if _SLUG.fullmatch(path.parent.name))

    def config_path(self, name: str) -> Path:
        """Where the config of this name is or will be."""
        return self.configs / f"{slug_from(name)}.toml"

    def keep_config(self, name: str, detector: SavedDetector) -> Path:
        """Save a detector config without overwriting a different one: as NAME, or NAME-2 and so on.

        Raises:
            ConfigError: if it cannot be written.
        """
        path = self.config_path(name)
        try:
            folder = begin_unfinished(self.configs)
            try:
                save_detector(*detector, folder / "config.toml")
                for path in map(self.config_path, numbered(slug_from(name), LONGEST_SLUG)):
                    # Not `claimed`: where another program writes the same config at the same time, that one will do.
                    with suppress(FileExistsError):
                        put_beside(folder / "config.toml", path)
                        break
                    if _holds(path, detector):
                        break
            finally:
                end_unfinished(folder)
        except OSError as error:
            raise ConfigError("cannot write the config", got=error.strerror, where=path, remedy=WRITE_REMEDY) from error
        return path

    def config_names(self) -> tuple[str, ...]:
        """Names of the saved configs."""
        return tuple(sorted(path.stem for path in self.configs.glob("*.toml") if _SLUG.fullmatch(path.stem)))

    def recording_path(self, name: str) -> Path:
        """Where the recording of this name is or will be."""
        return self.recordings / f"{slug_from(name)}.h5"

    def new_live_path(self) -> AbstractContextManager[Path]:
        """Where the recording of a live rally is to be that is begun now; to be made within the `with` block.

        Two browsers, of one server or of two, may freeze the rally in the same second, and labels hang on each of the
        recordings.
        """
        return free_path(self.recording_path(name) for name in numbered(time.strftime("live-%Y%m%d-%H%M%S")))

    def _folder(self, name: str) -> Path:
        folder = self.root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(
                "cannot use the workspace folder", got=error.strerror, where=folder, remedy="choose one with --data"
            ) from error
        return folder
