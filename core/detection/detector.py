"""Interface of all detectors and their result, and the registry of the event-based ones, ours and those of plugins,
with their settings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize, Window
from core.registry import Registry


@dataclass(frozen=True, slots=True)
class Detection:
    """A ball in the picture of one camera."""

    t_us: int
    """The time at which the position is valid (`paper`: the end of its window less its delay)."""
    u_px: float
    v_px: float
    r_px: float

    @property
    def centre_covariance_px2(self) -> NDArray[np.float64] | None:
        """(2, 2) covariance of u and v, px^2; None for a method without an uncertainty."""
        return None


class Detector(Protocol):
    """Finds at most one ball per window, windows given in order of time.

    It may offer two methods more. `why_not()` gives the `Reason`s why the last window had no ball: the limits that its
    nearest candidate failed, for `detect` and Tune. `explain(window)` is a step that gives a `MethodTrace`: what each
    stage kept, which Tune draws.
    """

    @property
    def extra_circles(self) -> int:
        """Circles of the last window that passed every test besides the answer; 0 for methods with only one."""
        ...

    def reset(self) -> None:
        """Forget everything seen before."""
        ...

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None. The window may be empty."""
        ...


Rgb = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionMethod:
    """A detector by its name, as `register_detector` describes it."""

    name: str
    make: Callable[[Any, SensorSize], Detector]
    """Takes the method's own section of the config, or all of it if `config` is None."""
    config: type | None
    """Config class of the method's own section; None for the staged pipeline, which takes all stages."""
    label: str
    """One line about it, for help and hints."""
    colour: Rgb
    """Colour of its circles and curves where methods are compared."""
    window_us: int
    """Length of its windows, unless a config says otherwise."""
    usual: tuple[str, ...]
    """Thresholds that automatic tuning searches by default; empty: all of its section."""
    stages: tuple[str, ...]
    """Sections of the staged pipeline that it takes; empty for every other method."""
    decide: Callable[[Any], Any]
    """Complete a config with the values that the method fixes itself."""
    views: tuple[str, ...]
    """Names of the views of its trace, see `MethodTrace`; a method without one has its events and its answer."""

    @property
    def section(self) -> str:
        """The name of its own section in a config: `fe-fusion` has [fe_fusion]."""
        return section_name(self.name)

    @property
    def sections(self) -> tuple[str, ...]:
        """The sections of a config that it takes its settings from."""
        return ("window", *(self.stages or (self.section,)))


def section_name(method: str) -> str:
    """The name of the section of a method."""
    return method.replace("-", "_")


DETECTORS: Final[Registry[DetectionMethod]] = Registry("detector", "rallyscope.detectors")
"""Every detector that looks at events, by name."""
