"""A window of time with the events in it, or the picture of an ordinary camera: what a detector is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.errors import EventsError
from core.events.events import Events


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """One picture with the middle of its exposure."""

    t_us: int
    exposure_us: int
    image: NDArray[np.uint8]
    """(height, width) or (height, width, 3 = RGB), read-only."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The events of one camera in the half-open interval [start_us, end_us), and a picture if one was taken in it."""

    events: Events
    start_us: int
    end_us: int
    frame: CameraFrame | None = None
    """Its mid exposure lies in the interval. For detectors that look at pictures; the others do not look at it."""

    def __post_init__(self) -> None:
        if self.end_us <= self.start_us:
            got = f"[{self.start_us}, {self.end_us}) us"
            raise EventsError("a window has no length", expected="start before end", got=got)
        t_us = self.events.t_us
        if len(t_us) and not (self.start_us <= t_us[0] and t_us[-1] < self.end_us):
            got = f"events from {t_us[0]} to {t_us[-1]} us"
            raise EventsError(f"events outside their window [{self.start_us}, {self.end_us}) us", got=got)
        if self.frame is not None and not self.start_us <= self.frame.t_us < self.end_us:
            got = f"a picture at {self.frame.t_us} us"
            raise EventsError(f"a picture outside its window [{self.start_us}, {self.end_us}) us", got=got)
