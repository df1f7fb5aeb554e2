"""The detectors that look at events, by the names they have on the command line and in the app."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, get_args

from core.detection.config import (
    DetectorConfig,
    auto_config,
    ebpp_config,
    fe_fusion_config,
    paper_config,
    refined_config,
)
from core.detection.detector import Detector
from core.detection.ebpp.detector import EbppDetector
from core.detection.fast.detector import FastDetector
from core.detection.fe_fusion.detector import FeFusionDetector
from core.detection.refined.detector import RefinedDetector
from core.detection.stage_trace import TrackState
from core.errors import CommandError
from core.events import SensorSize

Method = Literal["auto", "paper", "refined", "ebpp", "fe-fusion"]
METHODS: Final[dict[Method, str]] = {
    "auto": "the paper's stages, the leading polarity decided from the data",
    "paper": "the paper's stages, ON always leads",
    "refined": "both edges as one moving circle, every millisecond",
    "ebpp": "a rival: circles in a surface of the latest edges",
    "fe-fusion": "a rival: the centroid of one cluster of events",
}
"""Those that work, with what they are."""
DEFAULT_METHOD: Final[Method] = "refined"
"""Where nothing names a method."""
UNNAMED_METHOD: Final[Method] = "auto"
"""Of files, links and browsers' settings that name none: they were written when this was the default."""
_STAGES: Final = (
    "window", "hot_pixels", "flicker", "roi", "denoise", "cluster", "polarity", "geometry", "localise",
)  # fmt: skip
SECTIONS: Final[dict[Method, tuple[str, ...]]] = {
    "auto": _STAGES,
    "paper": _STAGES,
    "refined": ("window", "refined"),
    "ebpp": ("window", "ebpp"),
    "fe-fusion": ("window", "fe_fusion"),
}
"""The sections of `DetectorConfig` that each takes its settings from."""
STAGED: Final = frozenset({"auto", "paper"})
"""Those whose stages the readable pipeline shows."""
FRAME_METHODS: Final[dict[str, str]] = {"yolo": "a rival: YOLOv4-tiny on the pictures of a colour camera"}
"""Those that look at pictures, with what they are. Whoever wants one makes it: its network needs torch."""


def method_named(name: str) -> Method:
    """The method of that name.

    Raises:
        CommandError: for any other name, those of methods that look at pictures among them.
    """
    for method in get_args(Method):
        if method == name:
            return method
    known = " | ".join(METHODS)
    if name in FRAME_METHODS:
        remedy = f"`rallyscope detect --method {name}` runs it on a recording's pictures"
        raise CommandError(f"the method {name!r} looks at pictures, not at events", expected=known, remedy=remedy)
    raise CommandError(f"no method {name!r}", expected=known)


def method_config(method: str, config: DetectorConfig | None = None) -> DetectorConfig:
    """What `make_detector` runs: `paper` takes a config without what the paper does not do, the others as it is.

    Without one, each has its own: the methods without stages have windows of their own length.

    Raises:
        CommandError: for any other name, those of methods that look at pictures among them.
    """
    match method_named(method):
        case "paper":
            return paper_config(config)
        case "refined":
            return config or refined_config()
        case "ebpp":
            return config or ebpp_config()
        case "fe-fusion":
            return config or fe_fusion_config()
        case "auto":
            return config or auto_config()


def make_detector(method: str, sensor: SensorSize, config: DetectorConfig | None = None) -> Detector:
    """A detector for one camera.

    Raises:
        CommandError: for any other name, those of methods that look at pictures among them.
    """
    chosen = method_config(method, config)
    match method_named(method):
        case "refined":
            return RefinedDetector(chosen.refined, sensor)
        case "ebpp":
            return EbppDetector(chosen.ebpp, sensor)
        case "fe-fusion":
            return FeFusionDetector(chosen.fe_fusion, sensor)
        case "auto" | "paper":
            return FastDetector(chosen, sensor)


def states_of(detectors: Mapping[str, Detector]) -> dict[str, TrackState]:
    """What the detectors with stages remember, by camera: with it the readable pipeline shows the next window's."""
    return {name: one.state for name, one in detectors.items() if isinstance(one, FastDetector)}
