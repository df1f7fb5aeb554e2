"""The value that everything works on: a sorted, read-only batch of events of one sensor; and pictures of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import EventsError


@dataclass(frozen=True, slots=True)
class SensorSize:
    """Pixels of a sensor. Event address (0, 0) is the centre of the top left pixel, the point (0.0, 0.0)."""

    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        if not (0 < self.width_px <= 65536 and 0 < self.height_px <= 65536):
            raise EventsError("impossible sensor size", expected="1 to 65536 pixels a side", got=self)

    def __str__(self) -> str:
        return f"{self.width_px}x{self.height_px}"


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """N events of one sensor, sorted by time.

    Four C-contiguous read-only columns of length N. Make one with `Events.from_columns`, which casts and checks;
    the constructor itself trusts its caller (slices of checked events are checked events).
    """

    t_us: NDArray[np.int64]
    """Microseconds from the start of the recording, never decreasing."""
    x_px: NDArray[np.uint16]
    y_px: NDArray[np.uint16]
    on: NDArray[np.bool_]
    """True where the pixel became brighter."""
    sensor: SensorSize

    @staticmethod
    def from_columns(t_us: ArrayLike, x_px: ArrayLike, y_px: ArrayLike, on: ArrayLike, sensor: SensorSize) -> Events:
        """Events from any four equally long columns; copies only what has another type or layout.

        Args:
            t_us: (N,) times, never decreasing.
            x_px: (N,) columns.
            y_px: (N,) rows.
            on: (N,) polarities: whether the pixel became brighter.
            sensor: its size, which holds all addresses.

        Raises:
            EventsError: if lengths differ, time decreases, or an address lies outside the sensor.
        """
        t = np.ascontiguousarray(t_us, np.int64)
        x_wide, y_wide = np.asarray(x_px), np.asarray(y_px)
        polarity = np.ascontiguousarray(on, np.bool_)
        lengths = {t.shape, x_wide.shape, y_wide.shape, polarity.shape}
        if t.ndim != 1 or len(lengths) != 1:
            raise EventsError("event columns differ in shape", expected="four columns of one length", got=lengths)
        if t.size:
            backwards = np.flatnonzero(t[1:] < t[:-1])
            if backwards.size:
                at = int(backwards[0]) + 1
                raise EventsError(f"time runs backwards at event {at}", got=f"{t[at]} us after {t[at - 1]} us")
            for name, column, limit in (("x", x_wide, sensor.width_px), ("y", y_wide, sensor.height_px)):
                low, high = int(column.min()), int(column.max())
                if low < 0 or high >= limit:
                    got = f"{low} to {high}"
                    raise EventsError(f"{name} outside the {sensor} sensor", expected=f"0 to {limit - 1}", got=got)
        x, y = np.ascontiguousarray(x_wide, np.uint16), np.ascontiguousarray(y_wide, np.uint16)
        return Events(_read_only(t), _read_only(x), _read_only(y), _read_only(polarity), sensor)

    @staticmethod
    def empty(sensor: SensorSize) -> Events:
        """No events at all."""
        return Events.from_columns([], [], [], [], sensor)

    def __len__(self) -> int:
        return len(self.t_us)

    def between(self, start_us: int, end_us: int) -> Events:
        """The events with `start_us <= t < end_us`, without copying."""
        first, last = np.searchsorted(self.t_us, (start_us, end_us), side="left")
        return self.rows(slice(int(first), max(int(first), int(last))))

    def rows(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Events:
        """A subset in the same order: a slice without a step, a mask, or ascending indices."""
        return Events(
            _read_only(self.t_us[rows]),
            _read_only(self.x_px[rows]),
            _read_only(self.y_px[rows]),
            _read_only(self.on[rows]),
            self.sensor,
        )


def concatenate_events(parts: Sequence[Events], sensor: SensorSize) -> Events:
    """Consecutive parts of one stream as one.

    Raises:
        EventsError: if a part begins before the one in front of it ended.
    """
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return Events.empty(sensor)
    return Events.from_columns(
        np.concatenate([part.t_us for part in parts]),
        np.concatenate([part.x_px for part in parts]),
        np.concatenate([part.y_px for part in parts]),
        np.concatenate([part.on for part in parts]),
        sensor,
    )


def _read_only(column: NDArray) -> NDArray:
    if column.flags.writeable:
        column = column.view()
        column.flags.writeable = False
    return column


NO_EVENT = 0
OFF_EVENT = 1
ON_EVENT = 2


def polarity_image(events: Events, *, binning: int = 1) -> NDArray[np.uint8]:
    """NO_EVENT, OFF_EVENT or ON_EVENT per pixel: the polarity of its latest event.

    With `binning` n, n x n sensor pixels are one of the picture: a smaller picture in which single events still show.
    """
    image = np.zeros(_binned_shape(events, binning), np.uint8)
    # of repeated indices numpy keeps the last
    image[events.y_px // binning, events.x_px // binning] = events.on + np.uint8(OFF_EVENT)
    return image


def count_image(events: Events, *, binning: int = 1) -> NDArray[np.int64]:
    """Count the events of every pixel."""
    height, width = _binned_shape(events, binning)
    flat = (events.y_px // binning).astype(np.int64) * width + events.x_px // binning
    return np.bincount(flat, minlength=width * height).reshape(height, width)


def time_surface(events: Events, *, now_us: int, tau_us: float, binning: int = 1) -> NDArray[np.float32]:
    """exp(-(now - t) / tau) of each pixel's latest event at t, 0 where there was none.

    Args:
        events: in order of time.
        now_us: time at which the surface is 1.
        tau_us: time constant of the decay.
        binning: side of a cell, px.
    """
    surface = np.zeros(_binned_shape(events, binning), np.float32)
    surface[events.y_px // binning, events.x_px // binning] = np.exp((events.t_us - now_us) / tau_us)
    return surface


def _binned_shape(events: Events, binning: int) -> tuple[int, int]:
    return -(-events.sensor.height_px // binning), -(-events.sensor.width_px // binning)
