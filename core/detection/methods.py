"""The detectors by the names they have on the command line and in the app."""

from __future__ import annotations

from typing import Final, Literal, get_args

from core.detection.config import DetectorConfig, auto_config, paper_config
from core.detection.detector import Detector
from core.detection.fast.detector import FastDetector
from core.errors import CommandError, NotBuiltError
from core.events import SensorSize

Method = Literal["auto", "paper"]
METHODS: Final[dict[Method, str]] = {
    "auto": "the paper's stages, the leading polarity decided from the data",
    "paper": "the paper's stages, ON always leads",
}
"""Those that work, with what they are."""
PLANNED: Final = ("refined", "ebpp", "fe-fusion", "yolo")


def method_named(name: str) -> Method:
    """The method of that name.

    Raises:
        NotBuiltError: for a method that is planned.
        CommandError: for any other name.
    """
    for method in get_args(Method):
        if method == name:
            return method
    known = " | ".join(METHODS)
    if name in PLANNED:
        raise NotBuiltError(f"the method {name!r} is not built yet", remedy=f"use {known}")
    raise CommandError(f"no method {name!r}", expected=known)


def method_config(method: str, config: DetectorConfig | None = None) -> DetectorConfig:
    """What `make_detector` runs: `auto` takes a config as it is, `paper` takes it without what the paper does not do.

    Raises:
        NotBuiltError: for a method that is planned.
        CommandError: for any other name.
    """
    return paper_config(config) if method_named(method) == "paper" else config or auto_config()


def make_detector(method: str, sensor: SensorSize, config: DetectorConfig | None = None) -> Detector:
    """A detector for one camera.

    Raises:
        NotBuiltError: for a method that is planned.
        CommandError: for any other name.
    """
    return FastDetector(method_config(method, config), sensor)
