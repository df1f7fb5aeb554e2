"""Registry of the event-based detectors, ours and those of plugins, with their settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from core.detection.detector import Detector
from core.events import SensorSize
from core.registry import Registry

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
