"""Complete training: render, train, choose the confidence, score, write. It can be resumed after a kill.

Score of a trained network on unseen sharp pictures, and the choice of its confidence threshold. Sharp: exposures of 0.5
ms, in which a ball moves by less than its radius. The scenes, cameras and colours are those of `paper7`, taken by the
same cameras as in recordings; the flights have seeds of their own.
"""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import torch

from benchmarks.detector_training.pool import TrainingPictures, data_set_pool, rendered_pool
from benchmarks.detector_training.training import load_state, new_state, run_steps
from core.cameras import stereo_preset
from core.config import config_to_mapping
from core.detection.yolo.config import DetectorTrainingConfig, YoloConfig
from core.detection.yolo.detector import YoloDetector, find_circles
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import SharpScore, YoloWeights, save_weights
from core.errors import CommandError
from core.events import CameraFrame
from core.files import beside, hold
from core.metrics.grid_score import wholly_in_view
from core.metrics.score import MATCH_RADIUS_PX
from core.physics.config import PhysicsConfig
from core.recordings import PixelTruth
from core.recordings.frames import window_of
from core.simulation import LaunchConfig, pixel_truth, scene_named
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.frames import FrameConfig, FrameTrack

SEED: Final = 20_261
"""Seed of the flights that are scored; training draws its backgrounds from other streams."""
SHARP_US: Final = 500
RATE_HZ: Final = 15.0
SCENES: Final[tuple[tuple[str, str, float], ...]] = (
    ("ball", "side", 6.0),
    ("ball", "ceiling", 7.0),
    ("ball", "behind", 8.0),
    ("person", "behind", 6.0),
    ("two-persons", "side", 6.0),
    ("two-persons", "behind", 7.0),
    ("rally", "behind", 5.0),
)
"""Scene, placement of the cameras, and speed: the kinds of `paper7`."""
CONFIDENCES: Final = np.arange(5, 96, 5) / 100
MATCH_PX: Final = MATCH_RADIUS_PX / 2
"""In the network's input, for which 1280x720 is halved."""
STEP_US: Final = 50_000
Progress = Callable[[float], None]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Counts:
    asked: int = 0
    found: int = 0
    answers: int = 0
    right: int = 0
    error_px: tuple[float, ...] = ()


def choose_confidence(network: YoloTiny, config: YoloConfig, pictures: TrainingPictures, device: str) -> float:
    """Lowest confidence with the best F1; the config's own without pictures."""
    if not len(pictures):
        return config.confidence
    low = dataclasses.replace(config, confidence=float(CONFIDENCES[0]))
    sure, right, balls = [], [], 0
    for group in pictures.groups:
        for image, circle in zip(group.images, group.circles, strict=True):
            balls += bool(np.isfinite(circle).all())
            circles = find_circles(network, low, np.asarray(image), device)
            if len(circles):
                off = np.hypot(*(circles[0, :2] + 0.5 - circle[:2]))
                sure.append(float(circles[0, 3]))
                right.append(bool(off <= MATCH_PX))
    sure_of, is_right = np.array(sure), np.array(right, np.bool_)
    f1 = [
        2 * int((is_right & (sure_of >= least)).sum()) / max(1, int((sure_of >= least).sum()) + balls)
        for least in CONFIDENCES
    ]
    best = np.flatnonzero(np.array(f1) == max(f1))
    return float(CONFIDENCES[best[len(best) // 2]])


def score_sharp(
    weights: YoloWeights,
    device: str,
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
    *,
    scenes: tuple[tuple[str, str, float], ...] = SCENES,
    seed: int = SEED,
) -> SharpScore | None:
    """Recall, precision and error on sharp pictures; None if cancelled."""
    detector = YoloDetector(weights, device)
    total = _Counts()
    for number, (scene, placement, speed_mps) in enumerate(scenes):
        for share, frame, truth in sharp_frames(scene, placement, speed_mps, (seed, number)):
            if cancelled():
                return None
            total = _count(total, detector, frame, truth)
            progress((number + share) / len(scenes))
    return SharpScore(
        recall=round(total.found / max(1, total.asked), 4),
        precision=round(total.right / max(1, total.answers), 4),
        median_error_px=round(float(np.median(total.error_px)), 3) if total.error_px else float("nan"),
        pictures=total.asked,
        seed=seed,
    )


def sharp_frames(
    scene_name: str, placement: str, speed_mps: float, seed: tuple[int, int]
) -> Iterator[tuple[float, CameraFrame, tuple[PixelTruth, bool]]]:
    """Pictures of both cameras: the share of the flight that is over, the ball (1,), and if all of it is in view."""
    scene, cameras = scene_named(scene_name), stereo_preset(placement)
    rng = np.random.default_rng(seed)
    flights, strokes = draw_flights(scene, [LaunchConfig(speed_mps=speed_mps)], rng, PhysicsConfig())
    bodies = make_actors(scene.cast, seed[0], strokes)
    config = FrameConfig(rate_hz=RATE_HZ, exposure_us=SHARP_US)
    track = FrameTrack(cameras, scene, config, seed[0], bodies)
    end_us = int(flights.end_s * 1e6)
    for until_us in range(STEP_US, end_us + 1, STEP_US):
        for t_us, images in track.take_until(until_us, flights):
            for name, image in images.items():
                truth = pixel_truth(cameras[name], flights, t_us, bodies)
                whole = bool(wholly_in_view(truth, cameras[name].sensor)[0])
                yield until_us / end_us, CameraFrame(t_us, SHARP_US, image), (truth, whole)


def _count(so_far: _Counts, detector: YoloDetector, frame: CameraFrame, ball: tuple[PixelTruth, bool]) -> _Counts:
    truth, whole = ball
    answer = detector.step(window_of(frame))
    if answer is None:
        return dataclasses.replace(so_far, asked=so_far.asked + whole)
    off = float(np.hypot(answer.u_px - truth.u_px[0], answer.v_px - truth.v_px[0])) if truth.visible[0] else np.inf
    right = off <= MATCH_RADIUS_PX
    return _Counts(
        so_far.asked + whole,
        so_far.found + (whole and right),
        so_far.answers + 1,
        so_far.right + right,
        (*so_far.error_px, off) if right else so_far.error_px,
    )


CHOICE_SHARE: Final = 0.05
"""Share of the backgrounds, the last ones, that are held out: the confidence is chosen on them."""
RENDERED, TRAINED = 0.25, 0.9
"""Shares of all work after which the pictures are there, and the network is trained."""


def training_folder(out: Path) -> Path:
    """Where a training keeps its pictures and its checkpoint until the weights are written."""
    return beside(out, "", ".training")


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
    """Pictures to train with, and the last ones to choose the confidence on; a single group is all trained with."""
    groups = len(pool.groups)
    kept = groups - max(1, round(CHOICE_SHARE * groups)) if groups > 1 else groups
    return pool.part(0, kept), pool.part(kept, groups)
