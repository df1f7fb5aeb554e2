"""The detectors that look at events, by the names they have on the command line and in the app."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Final

from core.config import check_config_type, get_section
from core.detection.config import (
    EBPP_WINDOW_US,
    FE_FUSION_WINDOW_US,
    REFINED_WINDOW_US,
    DetectorConfig,
    paper_config,
)
from core.detection.detector import DETECTORS, DetectionMethod, Detector, Rgb, section_name
from core.detection.ebpp import VIEWS as EBPP_VIEWS
from core.detection.ebpp import EbppDetector
from core.detection.ebpp_config import EbppConfig
from core.detection.fast.detector import FastDetector
from core.detection.fe_fusion import VIEWS as FE_FUSION_VIEWS
from core.detection.fe_fusion import FeFusionDetector
from core.detection.fe_fusion_config import FeFusionConfig
from core.detection.method_trace import PLAIN_VIEWS
from core.detection.refined.detector import RefinedDetector
from core.detection.refined.view import VIEWS as REFINED_VIEWS
from core.detection.refined_config import RefinedConfig
from core.detection.stage_trace import TrackState
from core.detection.staged_view import VIEWS as STAGED_VIEWS
from core.detection.window import WindowConfig
from core.errors import CommandError, PluginError
from core.events import SensorSize

Method = str
"""The name of a detector in `METHODS`."""
METHODS: Final[Mapping[Method, str]] = DETECTORS.view(lambda one: one.label)
"""Registered methods with their descriptions."""
DEFAULT_METHOD: Final[Method] = "refined"
"""Method used where none is named."""
UNNAMED_METHOD: Final[Method] = "auto"
"""Method of files, links and browser settings that name none: this was the default when they were written."""
SECTIONS: Final[Mapping[Method, tuple[str, ...]]] = DETECTORS.view(lambda one: one.sections)
"""The sections of `DetectorConfig` that each takes its settings from."""
VIEWS: Final[Mapping[Method, tuple[str, ...]]] = DETECTORS.view(lambda one: one.views)
"""The views of each method's trace."""
FRAME_METHODS: Final[dict[str, str]] = {"yolo": "a rival: YOLOv4-tiny on the pictures of a colour camera"}
"""Methods that look at pictures, with their descriptions. The caller makes them, as their network needs torch."""


def register_detector(
    name: str,
    make: Callable[[Any, SensorSize], Detector],
    config: type | None,
    label: str,
    colour: Rgb,
    *,
    window_us: int = WindowConfig().window_us,
    usual: tuple[str, ...] = (),
    stages: tuple[str, ...] = (),
    decide: Callable[[DetectorConfig], DetectorConfig] = lambda config: config,
    views: tuple[str, ...] = PLAIN_VIEWS,
) -> None:
    """Add a detector: to the command line, Tune, comparisons, automatic tuning, scores and the contract tests.

    Args:
        name: on the command line and in the app; with underscores it is the section of its settings in a config.
        make: makes a detector for one camera from a `config` and the size of the sensor, such as its class.
        config: its settings, a frozen dataclass with defaults; sliders and TOML files are made from its fields.
        label: what it is, in a line.
        colour: of its circles and curves, red, green and blue from 0 to 255.
        window_us: length of its windows unless a config says otherwise.
        usual: the thresholds, such as `my_detector.radius_px`, that `tune` searches for; empty: all of `config`.
        stages: only for the staged pipeline, whose `config` is None: the stages it takes settings from.
        decide: puts into a config what the method decides itself.
        views: names of the views that its `explain` gives, the buttons of Tune.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"detector {name}"
    if not callable(make):
        raise PluginError("no way to make it", expected="a class or a function (config, sensor)", where=where)
    if not isinstance(label, str) or not label.strip():
        raise PluginError("no label", expected="a line that says what it is", got=repr(label), where=where)
    if not _is_colour(colour):
        expected = "(red, green, blue), each 0 to 255"
        raise PluginError("not a colour", expected=expected, got=repr(colour), where=where)
    if config is not None or not stages:
        _check_section(config, section_name(name), where)
    method = DetectionMethod(
        name=name,
        make=make,
        config=config,
        label=label,
        colour=colour,
        # Through the config, which checks the bounds.
        window_us=WindowConfig(window_us=window_us).window_us,
        usual=usual,
        stages=stages,
        decide=decide,
        views=views,
    )
    DETECTORS.register(name, method)


def _is_colour(colour: object) -> bool:
    if not isinstance(colour, tuple) or len(colour) != 3:
        return False
    return all(isinstance(part, int) and 0 <= part <= 255 for part in colour)


def _check_section(config: object, section: str, where: str) -> None:
    """Raises RallyscopeError unless sliders and files can be made of a config, in a section of its own."""
    check_config_type(config, where)
    declared = {item.name: item.default_factory for item in dataclasses.fields(DetectorConfig)}
    if section in declared and declared[section] is not config:
        raise PluginError("the config has a section of this name already", got=section, where=where)


_STAGES: Final = ("hot_pixels", "flicker", "roi", "denoise", "cluster", "polarity", "geometry", "localise")
_STAGED_USUAL: Final = (
    "roi.roi_expand_px", "denoise.kernel_px", "cluster.eps_px", "cluster.min_samples", "cluster.size_min",
    "polarity.outlier_radius_px", "geometry.circularity_min", "geometry.solidity_min", "localise.radius_min_px",
    "localise.radius_max_px", "localise.delay_us",
)  # fmt: skip
_REFINED_USUAL: Final = (
    "refined.motion_px", "refined.delay_us", "refined.residual_px", "refined.coverage_min", "refined.inside_max",
    "refined.fill_min", "refined.stray_max", "refined.evidence_min", "refined.confirm_fits", "refined.coast_us",
)  # fmt: skip

register_detector(
    "auto", FastDetector, None, "the paper's stages, the leading polarity decided from the data", (255, 240, 90),
    usual=_STAGED_USUAL, stages=_STAGES, views=STAGED_VIEWS,
)  # fmt: skip
register_detector(
    "paper", FastDetector, None, "the paper's stages, ON always leads", (255, 130, 210),
    usual=_STAGED_USUAL, stages=_STAGES, decide=paper_config, views=STAGED_VIEWS,
)  # fmt: skip
register_detector(
    "refined", RefinedDetector, RefinedConfig, "both edges as one moving circle, every millisecond", (113, 217, 127),
    window_us=REFINED_WINDOW_US, usual=_REFINED_USUAL, views=REFINED_VIEWS,
)  # fmt: skip
register_detector(
    "ebpp", EbppDetector, EbppConfig, "a rival: circles in a surface of the latest edges", (183, 111, 255),
    window_us=EBPP_WINDOW_US, views=EBPP_VIEWS,
)  # fmt: skip
register_detector(
    "fe-fusion", FeFusionDetector, FeFusionConfig, "a rival: the centroid of one cluster of events", (243, 89, 85),
    window_us=FE_FUSION_WINDOW_US, views=FE_FUSION_VIEWS,
)  # fmt: skip
DETECTORS.mark_built_in()
STAGED: Final = frozenset(name for name, one in DETECTORS.registered().items() if one.stages)
"""Methods whose stages the readable pipeline shows."""


def method_named(name: str) -> Method:
    """Method of this name.

    Raises:
        CommandError: for any other name, those of methods that look at pictures among them.
    """
    if name in METHODS:
        return name
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
    chosen = DETECTORS[method_named(method)]
    return chosen.decide(config or DetectorConfig(window=WindowConfig(window_us=chosen.window_us)))


def make_detector(method: str, sensor: SensorSize, config: DetectorConfig | None = None) -> Detector:
    """A detector for one camera.

    Raises:
        CommandError: for any other name, those of methods that look at pictures among them.
    """
    settings, chosen = method_config(method, config), DETECTORS[method]
    return chosen.make(settings if chosen.config is None else get_section(settings, chosen.section), sensor)


def states_of(detectors: Mapping[str, Detector]) -> dict[str, TrackState]:
    """State of the detectors with stages, by camera, from which the readable pipeline can show the next window."""
    return {name: one.state for name, one in detectors.items() if isinstance(one, FastDetector)}
