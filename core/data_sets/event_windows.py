"""A PyTorch data set of event windows with the ball's centre, over the recordings of a data set folder."""

from __future__ import annotations

import bisect
import itertools
import os
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, TypedDict

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from core.data_sets.index import read_index
from core.errors import ConfigError, RecordingError
from core.events import SensorSize
from core.recordings import Recording, open_recording

KEPT_OPEN: Final = 8
"""Recordings, per process."""


class WindowSample(TypedDict):
    """One window of one camera."""

    events: NDArray[np.float32]
    """(N, 4): x and y in px, time from 0 at the window's start to 1 at its end, 1 if ON and -1 if OFF; by time."""
    centre: NDArray[np.float32]
    """(3,): u, v and radius of the ball in px at the middle of the window; nan where it cannot be seen."""
    recording: str
    """The file."""
    camera: str
    start_us: int


class EventWindows(Dataset[WindowSample]):
    """Every window of every camera of the recordings, in order: half-open, `window_us` long, one every `every_us`.

    With `at_samples` there is one window about each sample of the truth instead: labels are seldom where a window is.
    Nothing but the truth is read before a window is asked for. It can be copied into the workers of a DataLoader: each
    process opens the files for itself.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        files: Iterable[str] | None = None,
        *,
        window_us: int = 2000,
        every_us: int = 2000,
        only_with_ball: bool = True,
        at_samples: bool = False,
    ) -> None:
        """Over these files of the data set, or all; what is trained on and what is tested on are best split by file.

        Raises:
            RecordingError: if it is no data set, a file is missing or is not the one of the index.
            ConfigError: if no such file is in the index, or a time is below 1 us.
        """
        if window_us < 1 or every_us < 1:
            got = f"window_us {window_us}, every_us {every_us}"
            raise ConfigError("windows have a length and a distance", expected="1 us or more", got=got)
        self._folder, self._window_us = Path(folder), window_us
        rows = {row["file"]: row for row in read_index(self._folder).to_pylist()}
        files = list(rows if files is None else files)
        if missing := [name for name in files if name not in rows]:
            raise ConfigError("not in the index of the data set", got=missing[0], where=str(self._folder))
        self._uuids = {name: str(rows[name]["uuid"]) for name in files}
        self._open: OrderedDict[str, Recording] = OrderedDict()
        # An HDF5 file that was opened before a fork cannot be read after it: a loader's workers open their own.
        self._opened_by = os.getpid()
        self._streams: list[tuple[str, str]] = []
        self._starts_us: list[NDArray[np.int64]] = []
        self._centres: list[NDArray[np.float32]] = []
        for name in self._uuids:
            self._add(name, every_us, only_with_ball, at_samples)
        self._ends = list(itertools.accumulate(map(len, self._starts_us)))

    def _add(self, name: str, every_us: int, only_with_ball: bool, at_samples: bool) -> None:
        recording = self._recording(name)
        end_us = recording.duration_us - self._window_us + 1
        for camera, stream in recording.cameras.items():
            starts_us = np.arange(0, end_us, every_us, dtype=np.int64)
            if at_samples:
                samples_us = np.zeros(0, np.int64) if stream.truth is None else stream.truth.t_us
                starts_us = samples_us - self._window_us // 2
                starts_us = starts_us[(starts_us >= 0) & (starts_us < end_us)]
            centres = np.full((len(starts_us), 3), np.nan, np.float32)
            if stream.truth is not None:
                at = stream.truth.at(starts_us + self._window_us // 2)
                centres = np.column_stack((at.u_px, at.v_px, at.r_px)).astype(np.float32)
            there = ~np.isnan(centres[:, 0]) if only_with_ball else np.ones(len(starts_us), np.bool_)
            self._streams.append((name, camera))
            self._starts_us.append(starts_us[there])
            self._centres.append(centres[there])

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, number: int) -> WindowSample:
        if not -len(self) <= number < len(self):
            raise IndexError(number)
        number %= len(self)
        stream = bisect.bisect_right(self._ends, number)
        row = number - (self._ends[stream - 1] if stream else 0)
        (name, camera), start_us = self._streams[stream], int(self._starts_us[stream][row])
        found = self._recording(name).cameras[camera].slice(start_us, start_us + self._window_us)
        since = (found.t_us - start_us) / self._window_us
        events = np.column_stack((found.x_px, found.y_px, since, np.where(found.on, 1, -1))).astype(np.float32)
        centre = self._centres[stream][row]
        return {"events": events, "centre": centre, "recording": name, "camera": camera, "start_us": start_us}

    def sensor(self, number: int) -> SensorSize:
        """Sensor size of the camera that recorded this window."""
        name, camera = self._streams[bisect.bisect_right(self._ends, number % len(self))]
        return self._recording(name).cameras[camera].sensor

    def close(self) -> None:
        """Let go of the files; they are opened again when a window is asked for."""
        while self._open:
            self._open.popitem()[1].close()

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_open": OrderedDict()}

    def _recording(self, name: str) -> Recording:
        if self._opened_by != os.getpid():  # a forked worker: the parent's files are not its own
            self._open, self._opened_by = OrderedDict(), os.getpid()
        recording = self._open.pop(name, None)
        if recording is None:
            recording = open_recording(self._folder / name)
            if recording.uuid != self._uuids[name]:
                recording.close()
                remedy = "make the data set again, or its index"
                raise RecordingError("not the recording of the index", where=self._folder / name, remedy=remedy)
            while len(self._open) >= KEPT_OPEN:
                self._open.popitem(last=False)[1].close()
        self._open[name] = recording
        return recording


def collate_windows(samples: Sequence[WindowSample]) -> tuple[torch.Tensor, torch.Tensor]:
    """A batch for a DataLoader: (M, 5) events with the number of their window first, and (B, 3) centres."""
    events = [
        np.column_stack((np.full(len(sample["events"]), number, np.float32), sample["events"]))
        for number, sample in enumerate(samples)
    ]
    centres = np.stack([sample["centre"] for sample in samples])
    return torch.from_numpy(np.concatenate(events)), torch.from_numpy(centres)


def count_pictures(events: torch.Tensor, windows: int, sensor: SensorSize) -> torch.Tensor:
    """(windows, 2, height, width): ON and OFF events of every pixel of a batch of `collate_windows`."""
    off = (events[:, 4] < 0).long()
    window, x, y = (events[:, column].long() for column in (0, 1, 2))
    place = ((window * 2 + off) * sensor.height_px + y) * sensor.width_px + x
    counts = torch.bincount(place, minlength=windows * 2 * sensor.height_px * sensor.width_px)
    return counts.reshape(windows, 2, sensor.height_px, sensor.width_px).float()
