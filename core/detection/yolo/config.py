"""Settings of `yolo` and of its training. They are stored with its weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from core.config import check_settings, setting
from core.errors import ConfigError

STRIDES: Final = (32, 16)
"""Pixels of the input that a cell of each of the two heads stands for, the coarse one first."""
Precision = Literal["float32", "bfloat16"]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorTrainingConfig:
    """AdamW on crops of rendered pictures. The defaults are ours; they fit an hour of one processor core."""

    seed: int = setting(0, 0, 2**31 - 1)
    """Seed of rendered backgrounds, crops and first weights."""
    yolo: YoloConfig = field(default_factory=YoloConfig)
    rooms: int = setting(80, 1, 100_000)
    """Number of random backgrounds: each has its own colours, light, camera, persons and flight."""
    frames_per_room: int = setting(14, 1, 1000)
    """Pictures per background, with random exposures."""
    steps: int = setting(2500, 1, 1_000_000)
    batch: int = setting(8, 1, 1024)
    """Crops per step."""
    crop_px: int = setting(224, 64, 2048, step=32)
    """Side of a crop, in pixels of the network's input: the network has no layer that knows the size of its input, and
    a crop with a ball teaches as much as a whole picture."""
    learning_rate: float = setting(1e-3, 1e-6, 0.1)
    """Learning rate after the warm-up; it decays to zero along a cosine."""
    warm_up_steps: int = setting(100, 0, 10_000)
    weight_decay: float = setting(5e-4, 0.0, 0.1)
    precision: Precision = "float32"
    """Number type of the layers' products in training: bfloat16 takes half the time on processors that have it."""
    checkpoint_every: int = setting(50, 1, 10_000)
    """Steps between checkpoints; after a kill the training resumes from the last one."""

    def __post_init__(self) -> None:
        check_settings(self)
