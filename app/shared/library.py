"""The recordings a browser may choose from, opened once and shared by all."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np

from app.shared.workspace import Workspace
from core.errors import RecordingError
from core.events import Health, assess_health
from core.recordings import Recording, open_recording

HEALTH_SAMPLES = 40
HEALTH_SAMPLE_US = 20_000


class Library:
    """Names of recordings -> open recordings. Safe to use from several threads."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._guests: dict[str, Path] = {}
        self._live: dict[str, Recording] = {}
        self._open: dict[str, Recording] = {}
        self._health: dict[tuple[str, str], Health] = {}
        self._lock = threading.Lock()

    def add_guest(self, path: Path) -> str:
        """Offer a recording from outside the workspace for as long as this process lives; returns its name."""
        name = path.stem
        while name in self._guests or name in self._workspace_names():
            name += "-file"
        self._guests[name] = path
        return name

    def add_live(self, name: str, recording: Recording) -> None:
        """Offer a recording that grows; it stays its owner's to close."""
        self._live[name] = recording

    def names(self) -> tuple[str, ...]:
        """What can be opened now: what is live, then the others in alphabetical order."""
        return (*self._live, *sorted({*self._guests, *self._workspace_names()} - set(self._live)))

    def has(self, name: str) -> bool:
        """Whether there is a recording of that name."""
        return name in self._live or name in self._guests or name in self._workspace_names()

    def open(self, name: str) -> Recording:
        """The recording of that name.

        Raises:
            RecordingError: if there is none or it cannot be read.
        """
        if name in self._live:
            return self._live[name]
        with self._lock:
            recording = self._open.get(name)
            if recording is None:
                recording = self._open[name] = open_recording(self._path(name))
            return recording

    def file_of(self, name: str) -> Path:
        """The file of a recording, for another process to open.

        Raises:
            RecordingError: if there is none: it is live, or not in the list.
        """
        if name in self._live:
            remedy = "record it in Watch, and open the recording"
            raise RecordingError("a live recording has no file yet", got=repr(name), remedy=remedy)
        return self._path(name)

    def health(self, name: str, camera: str) -> Health:
        """Health of one camera, worked out on first use (some 0.1 s)."""
        key = (name, camera)
        if key not in self._health:
            recording = self.open(name)
            stream = recording.cameras[camera]
            last_start_us = max(0, recording.duration_us - HEALTH_SAMPLE_US)
            starts_us = np.unique(np.linspace(0, last_start_us, HEALTH_SAMPLES).astype(np.int64))
            samples = (stream.slice(int(start), int(start) + HEALTH_SAMPLE_US) for start in starts_us)
            self._health[key] = assess_health(stream.counts_per_ms(), recording.duration_us, samples, stream.sensor)
        return self._health[key]

    def close(self) -> None:
        """Close every recording."""
        with self._lock:
            for recording in self._open.values():
                recording.close()
            self._open.clear()

    def _path(self, name: str) -> Path:
        if name in self._guests:
            return self._guests[name]
        if name in self._workspace_names():  # never a path made from what a browser sent
            return self._workspace.recordings / f"{name}.h5"
        raise RecordingError("no such recording", got=repr(name), remedy="choose one from the list")

    def _workspace_names(self) -> set[str]:
        return {path.stem for path in self._workspace.recordings.glob("*.h5") if not path.name.startswith(".")}
