"""The detectors by the names they have on the command line and in the app."""

from __future__ import annotations

from typing import Final

from core.detection.config import DetectorConfig, auto_config, paper_config
from core.detection.detector import Detector
from core.detection.fast.detector import FastDetector
from core.errors import CommandError, NotBuiltError
from core.events import SensorSize

METHODS: Final = {
    "auto": "the paper's stages, the leading polarity decided from the data",
    "paper": "the paper's stages, ON always leads",
}
"""Those that work, with what they are."""
PLANNED: Final = ("refined", "ebpp", "fe-fusion", "yolo")


def method_config(method: str, config: DetectorConfig | None = None) -> DetectorConfig:
    """What `make_detector` runs: `auto` takes a config as it is, `paper` takes it without what the paper does not do.

    Raises:
        NotBuiltError: for a method that is planned.
        CommandError: for any other name.
    """
    if method == "auto":
        return config or auto_config()
    if method == "paper":
        return paper_config(config)
    known = " | ".join(METHODS)
    if method in PLANNED:
        raise NotBuiltError(f"the method {method!r} is not built yet", remedy=f"use {known}")
    raise CommandError(f"no method {method!r}", expected=known)


def make_detector(method: str, sensor: SensorSize, config: DetectorConfig | None = None) -> Detector:
    """A detector for one camera.

    Raises:
        NotBuiltError: for a method that is planned.
        CommandError: for any other name.
    """
    return FastDetector(method_config(method, config), sensor)
