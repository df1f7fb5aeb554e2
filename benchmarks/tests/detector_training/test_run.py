"""Scores of detectors that see everything or nothing, on the sharp pictures of one flight."""

import numpy as np
import pytest
import torch

from benchmarks.detector_training import run as detector_run
from benchmarks.detector_training.pool import LabelledPictures, TrainingPictures
from benchmarks.detector_training.run import MATCH_PX, choose_confidence, score_sharp, sharp_frames
from core.detection.yolo.config import YoloConfig
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import YoloWeights

pytestmark = pytest.mark.numeric
ONE = (("ball", "side", 9.0),)


def untrained() -> YoloWeights:
    torch.manual_seed(0)
    return YoloWeights(YoloTiny(0.0625).eval(), YoloConfig(width=0.0625), None, {})


def knowing(offset_px: float):
    """Finds what is orange, that far to the right."""

    def find(network, config, image, device="cpu"):
        orange = (image[:, :, 0] > 150) & (image[:, :, 2] < 110) & (image[:, :, 1] < 200) & (image[:, :, 1] > 110)
        v, u = np.nonzero(orange)
        return np.array([[u.mean() + offset_px, v.mean(), 8.0, 0.9]]) if len(u) > 50 else np.empty((0, 4))

    return find


@pytest.fixture(scope="module")
def flight() -> list:
    """Of real pictures, taken once: they take seconds."""
    return list(sharp_frames(*ONE[0], (1, 0)))


def test_the_sharp_pictures_are_sharp_and_have_the_ball_where_they_say(flight) -> None:
    seen = [(frame, truth) for _, frame, (truth, whole) in flight if whole]
    assert len(seen) > 4 and all(frame.exposure_us == 500 for frame, _ in seen)
    frame, truth = seen[len(seen) // 2]
    u, v, r = round(float(truth.u_px[0])), round(float(truth.v_px[0])), float(truth.r_px[0])
    middle, beside = frame.image[v, u], frame.image[v, round(u + 3 * r)]
    assert middle[0] > middle[2] + 60, "orange"
    assert np.abs(middle.astype(int) - beside.astype(int)).max() > 60


@pytest.mark.parametrize(("offset_px", "least", "most"), [(0.0, 0.8, 1.0), (30.0, 0.0, 0.0)])
def test_a_score_counts_what_is_within_8_px(monkeypatch, flight, offset_px: float, least: float, most: float) -> None:
    monkeypatch.setattr(detector_run, "sharp_frames", lambda *which: iter(flight))
    monkeypatch.setattr("core.detection.yolo.detector.find_circles", knowing(offset_px))
    shares: list[float] = []
    score = score_sharp(untrained(), "cpu", shares.append, scenes=ONE, seed=1)
    assert score is not None and score.pictures > 4
    assert least <= score.recall <= most and least <= score.precision <= most
    assert 0 < max(shares) <= 1.0


def test_cancelled_there_is_no_score(monkeypatch, flight) -> None:
    monkeypatch.setattr(detector_run, "sharp_frames", lambda *which: iter(flight))
    assert score_sharp(untrained(), "cpu", cancelled=lambda: True, scenes=ONE) is None


def test_the_confidence_is_chosen_where_right_and_wrong_part(monkeypatch) -> None:
    circles = np.array([[20.0, 20.0, 5.0]] * 10 + [[np.nan] * 3] * 10)
    images = np.arange(20, dtype=np.uint8)[:, None, None, None] * np.ones((1, 8, 8, 3), np.uint8)

    def find(network, config, image, device="cpu"):
        number = int(image[0, 0, 0])
        sure = 0.6 if number < 10 else 0.3  # the ball, and something else where there is none
        return np.array([[19.5 + MATCH_PX / 2, 19.5, 5.0, sure]])

    monkeypatch.setattr(detector_run, "find_circles", find)
    pool = TrainingPictures((LabelledPictures(images, circles),))
    chosen = choose_confidence(untrained().network, YoloConfig(), pool, "cpu")
    assert 0.3 < chosen <= 0.6
    assert choose_confidence(untrained().network, YoloConfig(confidence=0.4), TrainingPictures(()), "cpu") == 0.4
