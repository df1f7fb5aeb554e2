"""Settings of `yolo`, and the size of its network. Both are stored with its weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from core.config import check_settings, setting
from core.errors import ConfigError

STRIDES: Final = (32, 16)
"""Pixels of the input that a cell of each of the two heads stands for, the coarse one first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class YoloConfig:
    """YOLOv4-tiny (Bochkovskiy et al. 2020, arXiv 2004.10934; the tiny one Wang et al. 2021, arXiv 2011.08036)."""

    input_width_px: int = setting(640, 32, 2048, step=32)
    """Width of the network's input. 1280x720 is halved for it: a ball of 6 to 20 px is one of 3 to 10 px, which a cell
    of 16 px finds. The published 416 would make 2 to 6.5 px of it, the full size takes four times as long."""
    input_height_px: int = setting(384, 32, 2048, step=32)
    """A picture is made smaller, never larger, until it fits, and gets grey borders."""
    width: float = setting(1.0, 0.0625, 2.0)
    """Channels of every layer as a share of the published ones."""
    confidence: float = setting(0.5, 0.01, 0.99, step=0.01)
    """Smallest confidence of a ball. Training sets the best value on rendered pictures used for neither training nor
    scores."""
    overlap: float = setting(0.3, 0.05, 0.95, step=0.05)
    """Largest intersection over union of two boxes: beyond it the less confident one is dropped."""

    def __post_init__(self) -> None:
        check_settings(self)
        for name in ("input_width_px", "input_height_px"):
            if getattr(self, name) % STRIDES[0]:
                expected, where = f"a multiple of {STRIDES[0]}", f"YoloConfig.{name}"
                raise ConfigError(
                    "cells do not fill the input", expected=expected, got=getattr(self, name), where=where
                )
