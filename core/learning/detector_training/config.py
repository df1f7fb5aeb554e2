"""Settings of the training of a frame detector. They are stored with the weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from core.config import check_settings, setting
from core.detection.yolo.config import YoloConfig

Precision = Literal["float32", "bfloat16"]


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
