"""The recordings a browser may choose from, opened once and shared by all."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from app.shared.workspace import Workspace
from core.errors import RecordingError
from core.events import Health, assess_health, sample_spans
from core.recordings import ImportOrder, Recording, import_recording, open_recording
from core.recordings.sources.readers import event_files


class Library:
    """Names of recordings -> open recordings. Safe to use from several threads."""

    def __init__(self, workspace: Workspace, folders: Sequence[Path] = ()) -> None:
        """Files in `folders` are added one by one by `add_external` when they are opened."""
        self.folders = tuple(folders)
        self._workspace = workspace
        self._external: dict[str, Path] = {}
        self._live: dict[str, Recording] = {}
        self._open: dict[str, Recording] = {}
        self._imported: dict[str, str] = {}
        self._health: dict[tuple[str, str], Health] = {}
        self._lock = threading.Lock()
        self._health_lock = threading.Lock()

    def add_external(self, path: Path) -> str:
        """Offer a recording for as long as this process lives; returns its name: one of the workspace keeps its own."""
        if (
            path.stem in self._workspace_names()
            and self._workspace.recording_path(path.stem).resolve() == path.resolve()
        ):
            return path.stem
        for name, known in self._external.items():
            if known == path:
                return name
        name = path.stem
        while name in self._external or name in self._workspace_names():
            name += "-file"
        self._external[name] = path
        return name

    def add_live(self, name: str, recording: Recording) -> None:
        """Add a growing recording; its owner closes it."""
        self._live[name] = recording

    def file_to_import(self, name: str) -> Path | None:
        """Event file of this name; None if it is a recording."""
        return self._files_to_import().get(name)

    def settled_name(self, name: str) -> str:
        """Name of the recording that an event file was imported as; other names are unchanged."""
        return self._imported.get(name, name)

    def names(self) -> tuple[str, ...]:
        """Names of all recordings: live ones, then the others in alphabetical order."""
        files = {*self._external, *self._workspace_names(), *self._files_to_import()}
        return (*self._live, *sorted(files - set(self._live)))

    def has(self, name: str) -> bool:
        """Whether there is a recording of this name."""
        return name in self._imported or name in self._live or name in self._external or name in self._workspace_names()

    def open(self, name: str) -> Recording:
        """Open the recording of this name.

        Raises:
            RecordingError: if there is none or it cannot be read.
        """
        if name in self._live:
            return self._live[name]
        with self._lock:
            name = self._import(name)
            recording = self._open.get(name)
            if recording is None:
                recording = self._open[name] = open_recording(self._path(name))
            return recording

    def file_of(self, name: str) -> Path:
        """File of a recording, for another process to open.

        Raises:
            RecordingError: if there is none: it is live, or not in the list.
        """
        if name in self._live:
            remedy = "record it in Watch, and open the recording"
            raise RecordingError("a live recording has no file yet", got=repr(name), remedy=remedy)
        return self._path(name)

    def health(self, name: str, camera: str) -> Health:
        """Health of one camera, computed on first use (about 0.1 s)."""
        key = (name, camera)
        with self._health_lock:  # concurrent callers wait for it
            if key not in self._health:
                recording = self.open(name)
                stream = recording.cameras[camera]
                samples = (stream.slice(*span) for span in sample_spans(recording.duration_us))
                self._health[key] = assess_health(stream.counts_per_ms(), recording.duration_us, samples, stream.sensor)
            return self._health[key]

    def close(self) -> None:
        """Close every recording."""
        with self._lock:
            for recording in self._open.values():
                recording.close()
            self._open.clear()

    def _import(self, name: str) -> str:
        """Import an event file of the workspace, once; returns the recording's name."""
        if name in self._imported:
            return self._imported[name]
        source = self._files_to_import().get(name)
        if source is None:
            return name
        import_recording(ImportOrder([source]), source.with_suffix(".h5"))
        self._imported[name] = source.stem
        return source.stem

    def _files_to_import(self) -> dict[str, Path]:
        """Name in the list -> event file of the workspace that is not imported yet."""
        recordings, called = self._workspace_names(), event_files()
        return {
            f"{path.name} ({called[path.suffix.lower()]}, imported when opened)": path
            for path in self._workspace.recordings.iterdir()
            if path.suffix.lower() in called and not path.name.startswith(".") and path.stem not in recordings
        }

    def _path(self, name: str) -> Path:
        name = self._imported.get(name, name)
        if name in self._external:
            return self._external[name]
        if name in self._workspace_names():  # never a path made from what a browser sent
            return self._workspace.recordings / f"{name}.h5"
        raise RecordingError("no such recording", got=repr(name), remedy="choose one from the list")

    def _workspace_names(self) -> set[str]:
        return {path.stem for path in self._workspace.recordings.glob("*.h5") if not path.name.startswith(".")}
