"""Our recording file, read: time slices of its cameras from any number of threads."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Final, Self

import h5py
import numpy as np

from core.cameras import Camera
from core.errors import RallyscopeError, RecordingError
from core.events import SensorSize
from core.recordings import layout
from core.recordings.file_camera import FileCamera
from core.recordings.frames import FrameStream, read_frames
from core.recordings.hdf5 import (
    HDF5_ERRORS,
    DamageNotes,
    attribute,
    dataset_at,
    group_at,
    has_attribute,
    has_item,
    hdf5_errors,
    kind_at,
    names_in,
    place_of,
    text_of,
    whole_number,
)
from core.recordings.ms_index import MAX_TIME_US
from core.recordings.recording import CameraStream
from core.recordings.truth import BallTruth, credible_ball
from core.text import parse_json

MAX_GROUPS: Final = 1000


class FileRecording:
    """A recording of ours on disk."""

    def __init__(self, path: Path, *, on_close: Callable[[], None] | None = None) -> None:
        """Open the file; nothing is read before it is asked for.

        Raises:
            RecordingError: if it is damaged or of a newer version.
        """
        self.path = path
        self._on_close = on_close
        self._threads = ThreadPoolExecutor(2, thread_name_prefix="unpack")
        self._damage = DamageNotes()
        try:
            self._file = h5py.File(path, "r")
        except HDF5_ERRORS as error:
            raise RecordingError("the HDF5 file cannot be opened", got=error, where=path) from error
        try:
            self._read_header()
        except BaseException:
            self._threads.shutdown()
            self._file.close()
            raise

    def _read_header(self) -> None:
        file = self._file
        version = whole_number(file, "version", 0, 2**31)
        if version > layout.VERSION:
            raise RecordingError(
                "the recording is of a newer version",
                expected=f"version {layout.VERSION} or below",
                got=version,
                where=self.path,
                remedy="update Rallyscope",
            )
        self.uuid = self._read_uuid()
        self._read_remarks()
        self._cameras = self._read_cameras()
        self.duration_us = self._read_duration()

    def _read_uuid(self) -> str:
        uuid = text_of(self._file, "uuid")
        if not re.fullmatch(r"[\w.-]{1,100}", uuid):
            expected = "letters, digits, dots and dashes"
            raise RecordingError("the uuid is damaged", expected=expected, got=repr(uuid)[:80], where=self.path)
        return uuid

    def _read_remarks(self) -> None:
        """What is good to know but not needed: notes, seed and config."""
        self.seed: int | None = None
        self.config: dict[str, object] | None = None
        if has_attribute(self._file, "notes"):
            with self._damage.left_out("notes"):
                notes = np.atleast_1d(attribute(self._file, "notes"))
                if notes.dtype.kind not in "OUS" or notes.ndim != 1:
                    raise RecordingError("they are no texts", got=notes.dtype)
                texts = (note.decode("utf-8", "replace") if isinstance(note, bytes) else str(note) for note in notes)
                for text in texts:
                    self._damage.add(text)
        if has_attribute(self._file, "seed"):
            with self._damage.left_out("the seed"):
                self.seed = whole_number(self._file, "seed", 0, 2**64)
        if has_attribute(self._file, "config"):
            with self._damage.left_out("the config"):
                self.config = _parse_config(text_of(self._file, "config"))

    def _read_cameras(self) -> dict[str, CameraStream]:
        group = group_at(self._file, "cameras")
        found: dict[str, CameraStream] = {}
        lost: RallyscopeError | None = None
        for name in self._names_of_cameras(group):
            try:
                if _has_events(group, name):
                    found[name] = FileCamera(self, group_at(group, name), self._threads, self._damage)
            except RallyscopeError as error:
                lost = error
                self._damage.add(f"Camera {name} is left out: {error}.")
        if lost is not None and not found:
            raise lost
        return found

    def _names_of_cameras(self, group: h5py.Group) -> list[str]:
        there, order = names_in(group), None
        if has_attribute(group, "order"):
            with self._damage.left_out("the order of the cameras"):
                order = [str(name) for name in np.atleast_1d(attribute(group, "order")).tolist()]
        if order is None or sorted(order) != sorted(there):
            if order is not None:
                self._damage.add("The order of the cameras names others than those in the file.")
            return sorted(there)
        return order

    def _read_duration(self) -> int:
        """Duration given by the file, but never less than its events need, us."""
        ends = [camera.end_us for camera in self._cameras.values() if isinstance(camera, FileCamera)]
        needed = max(ends, default=0)
        try:
            stated = whole_number(self._file, "duration_us", 0, MAX_TIME_US)
        except RecordingError as error:
            self._damage.add(f"The duration is that of the events: {error}.")
            return needed
        if stated < needed:
            self._damage.add(f"The duration is that of the events: the file says {stated:,} us.")
        return max(stated, needed)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know; what is damaged is told when it was asked for."""
        return self._damage.texts

    @property
    def cameras(self) -> dict[str, CameraStream]:
        return dict(self._cameras)

    @property
    def groups(self) -> tuple[str, ...]:
        """Every group of columns outside /cameras, such as "/racket" or "/ground_truth/ball"."""
        self.check_open()
        found: list[str] = []
        with self._damage.left_out("a group"):
            _find_groups(group_at(self._file, "/"), "", found, set())
        return tuple(found)

    def read_rows(self, group: str) -> layout.Rows | None:
        """All columns of a group; None if the recording does not have it, or with a note if it is damaged."""
        self.check_open()
        name = "/" + group.strip("/")
        parent, _, own = name.rpartition("/")
        try:
            above = group_at(self._file, parent or "/")
            if own not in names_in(above):
                return None
        except RecordingError:
            return None
        with self._damage.left_out(f"the group {name}"):
            rows = layout.read_rows(group_at(above, own))
            layout.check_known_rows(name, rows)
            return rows
        return None

    @property
    def ball(self) -> BallTruth | None:
        return self._ball

    @cached_property
    def _ball(self) -> BallTruth | None:
        rows = self.read_rows(layout.BALL_GROUP)
        if rows is None:
            return None
        stated = layout.ball_from_rows(rows)
        ball = credible_ball(stated)
        if ball is not stated:
            self._damage.add("The true ball is at absurd places now and then: it counts as not visible there.")
        return ball

    @cached_property
    def frames(self) -> dict[str, FrameStream]:
        """Pictures of ordinary cameras, by camera."""
        self.check_open()
        group = group_at(self._file, "cameras")
        found: dict[str, FrameStream] = {}
        for name in names_in(group):
            if has_item(group, f"{name}/frames"):
                with self._damage.left_out(f"the pictures of camera {name}"):
                    found[name] = read_frames(group_at(group, f"{name}/frames"), self._calibration_of(name))
        return found

    def _calibration_of(self, name: str) -> Camera | None:
        """The lens and pose of a frame camera, which has its own where its events are not read."""
        if name in self._cameras:
            return self._cameras[name].calibration
        group = group_at(self._file, f"cameras/{name}")
        if not has_item(group, "calibration"):
            return None
        with self._damage.left_out(f"the calibration of camera {name}"):
            sensor = SensorSize(*(whole_number(group, side, 1, 65536) for side in ("width", "height")))
            return layout.read_calibration(group_at(group, "calibration"), sensor)
        return None

    def check_open(self) -> None:
        if not self._file.id.valid:
            raise RecordingError("the recording is closed", where=self.path)

    def close(self) -> None:
        if self._file.id.valid:
            self._threads.shutdown(wait=True, cancel_futures=True)
            self._file.close()
            if self._on_close is not None:
                self._on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _has_events(cameras: h5py.Group, name: str) -> bool:
    """Not so for an ordinary camera, which is in the file for its frames."""
    return not has_item(cameras, f"{name}/frames") or dataset_at(cameras, f"{name}/events/t").shape != (0,)


def _parse_config(text: str) -> dict[str, object]:
    try:
        config = parse_json(text)
    except (ValueError, RecursionError) as error:
        raise RecordingError("it is no JSON", got=error) from error
    if not isinstance(config, dict):
        raise RecordingError("it is no table of settings", got=type(config).__name__)
    return config


def _find_groups(group: h5py.Group, path: str, found: list[str], seen: set[object]) -> None:
    """Groups of columns below one, but for those of cameras; every group once, though links may make a circle."""
    with hdf5_errors("a group cannot be read", place_of(group)):
        if group.id in seen or len(seen) > MAX_GROUPS:
            return
        seen.add(group.id)
    for name in names_in(group):
        here = f"{path}/{name}"
        kind = None if here == "/cameras" else kind_at(group, name)
        if kind is h5py.Group:
            _find_groups(group_at(group, name), here, found, seen)
        elif kind is h5py.Dataset and path and path not in found:
            found.append(path)
