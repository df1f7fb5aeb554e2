"""All thresholds: one section for each stage of the paper's detector, and for each method without stages."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Final

from core.config import Sections, normal_sections, open_sections
from core.detection.detector import DETECTORS, section_name
from core.detection.ebpp_config import EbppConfig
from core.detection.fe_fusion_config import FeFusionConfig
from core.detection.refined_config import RefinedConfig
from core.detection.stages.cluster import ClusterConfig
from core.detection.stages.denoise import DenoiseConfig
from core.detection.stages.flicker import FlickerConfig
from core.detection.stages.geometry import GeometryConfig
from core.detection.stages.hot_pixels import HotPixelConfig
from core.detection.stages.localise import LocaliseConfig
from core.detection.stages.polarity import PolarityConfig
from core.detection.stages.roi import RoiConfig
from core.detection.window import WindowConfig

REFINED_WINDOW_US: Final = 1000
EBPP_WINDOW_US: Final = 2000
FE_FUSION_WINDOW_US: Final = 1500


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """Every setting of the detector, in the order of its stages. The defaults are those of the method `auto`."""

    window: WindowConfig = field(default_factory=WindowConfig)
    hot_pixels: HotPixelConfig = field(default_factory=HotPixelConfig)
    flicker: FlickerConfig = field(default_factory=FlickerConfig)
    roi: RoiConfig = field(default_factory=RoiConfig)
    denoise: DenoiseConfig = field(default_factory=DenoiseConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    polarity: PolarityConfig = field(default_factory=PolarityConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    localise: LocaliseConfig = field(default_factory=LocaliseConfig)
    refined: RefinedConfig = field(default_factory=RefinedConfig)
    """Settings of the method `refined`, which uses only these and the window."""
    ebpp: EbppConfig = field(default_factory=EbppConfig)
    """Settings of the method `ebpp`, which uses only these and the window."""
    fe_fusion: FeFusionConfig = field(default_factory=FeFusionConfig)
    """Settings of the method `fe-fusion`, which uses only these and the window."""
    registered: Sections = open_sections(
        DETECTORS.view(lambda one: one.config or object, where=lambda one: one.config is not None, key=section_name)
    )
    """Settings of each other registered method: a section of its name."""

    def __post_init__(self) -> None:
        normal_sections(self)


def auto_config() -> DetectorConfig:
    """The settings of `auto`: the paper's stages, with the leading polarity decided from the data."""
    return DetectorConfig()


def refined_config() -> DetectorConfig:
    """The settings of `refined`: a window of 1 ms, however long its history is."""
    return DetectorConfig(window=WindowConfig(window_us=REFINED_WINDOW_US))


def ebpp_config() -> DetectorConfig:
    """The settings of `ebpp`, tuned with windows of this length."""
    return DetectorConfig(window=WindowConfig(window_us=EBPP_WINDOW_US))


def fe_fusion_config() -> DetectorConfig:
    """The settings of `fe-fusion`, tuned with windows of this length."""
    return DetectorConfig(window=WindowConfig(window_us=FE_FUSION_WINDOW_US))


def paper_config(config: DetectorConfig | None = None) -> DetectorConfig:
    """The paper's method: ON always leads, no optional stages. Other settings are those of `config`."""
    config = config or DetectorConfig()
    return dataclasses.replace(
        config,
        hot_pixels=dataclasses.replace(config.hot_pixels, enabled=False),
        flicker=dataclasses.replace(config.flicker, enabled=False),
        polarity=dataclasses.replace(config.polarity, leading_polarity="on"),
    )
