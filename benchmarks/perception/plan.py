"""What is measured: methods on the recordings of `paper7`, made once for each seed, and where the results are kept."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Final

from core.chain.config import ChainConfig, published_chain
from core.chain.physics import chain_for_physics
from core.config import config_to_mapping
from core.data_sets import DataSetPlan, preset_plan
from core.data_sets.plan import Making
from core.data_sets.presets import PAPER7_FRAMES
from core.detection.methods import Method
from core.physics.config import physics_profile

METHODS: Final[tuple[Method, ...]] = ("paper", "auto", "refined", "ebpp", "fe-fusion")
FRAME_METHODS: Final = ("yolo",)
"""Those that look at the pictures of the same recordings."""
ROWS: Final = (*METHODS, *FRAME_METHODS)
RIVALS: Final[tuple[Method, ...]] = ("ebpp", "fe-fusion")
FIRST_SEED: Final = 7
BALL_ONLY: Final = "ball"
"""The scene of the recordings without people."""


def seed_plan(seed: int) -> DataSetPlan:
    """The seven recordings of a seed, as `rallyscope simulate --preset paper7` makes them."""
    return preset_plan("paper7", seed, Making(frames=PAPER7_FRAMES))


def set_folder(folder: Path, seed: int) -> Path:
    """Where the recordings of a seed are."""
    return folder / f"paper7-{seed}"


def chain_of(method: Method) -> ChainConfig:
    """The chain from a method's detections to the hitting point: `paper` predicts as published too.

    It is told the physics of the recordings: methods that find the ball are compared, not what a filter finds out.
    """
    if method == "paper":
        return published_chain()
    return chain_for_physics(ChainConfig.of_method(method), physics_profile(Making(frames=PAPER7_FRAMES).physics))


def result_path(folder: Path, seed: int, recording: str, method: Method) -> Path:
    """Path of one method's result on one recording; its settings are part of the name."""
    settings = json.dumps(config_to_mapping(chain_of(method)), sort_keys=True, default=str)
    stamp = hashlib.sha256(settings.encode()).hexdigest()[:10]
    return folder / "results" / str(seed) / f"{recording}-{method}-{stamp}.json"


def frame_result_path(folder: Path, seed: int, recording: str, method: str, stamp: str) -> Path:
    """Result path of a frame-based method; the stamp identifies its weights."""
    return folder / "results" / str(seed) / f"{recording}-{method}-{stamp}.json"


def reading_path(folder: Path, seed: int, recording: str) -> Path:
    """Path of what does not depend on the method: frames, and the read time per event."""
    return folder / "results" / str(seed) / f"{recording}.json"
