"""Complete training: render, train, choose the confidence, score, write. It can be resumed after a kill."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

import torch

from core.config import config_to_mapping
from core.detection.yolo.weights import SharpScore, YoloWeights, save_weights
from core.errors import CommandError
from core.files import hold
from core.learning.detector_training.config import DetectorTrainingConfig
from core.learning.detector_training.held_out import choose_confidence, score_sharp
from core.learning.detector_training.pool import TrainingPictures, data_set_pool, rendered_pool
from core.learning.detector_training.training import load_state, new_state, run_steps

CHOICE_SHARE: Final = 0.05
"""Share of the backgrounds, the last ones, that are held out: the confidence is chosen on them."""
RENDERED, TRAINED = 0.25, 0.9
"""Shares of all work after which the pictures are there, and the network is trained."""
Progress = Callable[[float], None]


def training_folder(out: Path) -> Path:
    """Where a training keeps its pictures and its checkpoint until the weights are written."""
    return out.with_name(f"{out.name}.training")


def train_detector(
    out: Path,
    config: DetectorTrainingConfig,
    *,
    data: Path | None = None,
    device: str = "auto",
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> SharpScore | None:
    """Train, score and write the weights; None if cancelled before, and the same call goes on from there.

    The pictures are rendered, or are those of the recordings in the folder `data`.

    Raises:
        ConfigError: if a training with other settings was begun there.
        RecordingError: if `data` has no pictures with the truth.
        CommandError: if there is no such device, or another process trains there.
    """
    device, folder = find_device(device), training_folder(out)
    try:
        with hold(folder / "lock"):
            weights = _train(folder, config, data, device, progress, cancelled)
            score = None if weights is None else weights.score
            if weights is not None:
                save_weights(out, weights)
    except TimeoutError as error:
        raise CommandError("another process trains here", where=folder, remedy="wait for its end") from error
    if score is not None:
        shutil.rmtree(folder)
    return score


def find_device(name: str) -> str:
    """Device that `auto` stands for, or the given device.

    Raises:
        CommandError: if torch sees no such device.
    """
    there = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    if name == "auto":
        return there[-1]
    if name.split(":")[0] not in there:
        raise CommandError(f"no device {name!r}", expected=f"auto, {', '.join(there)}", where="--device")
    return name


def _train(
    folder: Path,
    config: DetectorTrainingConfig,
    data: Path | None,
    device: str,
    progress: Progress,
    cancelled: Callable[[], bool],
) -> YoloWeights | None:
    def rendering(share: float) -> None:
        progress(RENDERED * share)

    def training(share: float) -> None:
        progress(RENDERED + (TRAINED - RENDERED) * share)

    def scoring(share: float) -> None:
        progress(TRAINED + (1 - TRAINED) * share)

    pool = (
        rendered_pool(folder / "pictures", config, rendering, cancelled)
        if data is None
        else data_set_pool(data, config, rendering)
    )
    if cancelled():
        return None
    learnt, chosen_on = split_pool(pool)
    checkpoint = folder / "checkpoint.safetensors"
    state = load_state(checkpoint, config, device) if checkpoint.exists() else new_state(config, device)
    if not run_steps(
        state, config, learnt, device=device, checkpoint=checkpoint, progress=training, cancelled=cancelled
    ):
        return None
    confidence = choose_confidence(state.network, config.yolo, chosen_on, device)
    yolo = dataclasses.replace(config.yolo, confidence=confidence)
    made_by = {**config_to_mapping(config), "plans": [list(plan) for plan in state.plans]}
    weights = YoloWeights(state.network, yolo, None, made_by)
    score = score_sharp(weights, device, scoring, cancelled)
    return None if score is None else dataclasses.replace(weights, score=score)


def split_pool(pool: TrainingPictures) -> tuple[TrainingPictures, TrainingPictures]:
    """Those to train with, and the last ones to choose the confidence on; of a single group all are trained with."""
    groups = len(pool.groups)
    kept = groups - max(1, round(CHOICE_SHARE * groups)) if groups > 1 else groups
    return pool.part(0, kept), pool.part(kept, groups)
