import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.detector_training.pool import LabelledPictures, TrainingPictures
from benchmarks.detector_training.training import learning_rate, load_state, new_state, run_steps
from core.detection.yolo.config import DetectorTrainingConfig, YoloConfig
from core.errors import ConfigError

pytestmark = pytest.mark.numeric
CONFIG = DetectorTrainingConfig(
    yolo=YoloConfig(input_width_px=128, input_height_px=96, width=0.0625),
    steps=7, batch=2, crop_px=64, warm_up_steps=2, checkpoint_every=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def pool() -> TrainingPictures:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (6, 96, 128, 3), np.uint8)
    return TrainingPictures((LabelledPictures(images, rng.uniform([10, 10, 3], [118, 86, 9], (6, 3))),))


@pytest.fixture(scope="module")
def uninterrupted(pool) -> tuple[dict[str, torch.Tensor], list[float]]:
    state = new_state(CONFIG, "cpu")
    assert run_steps(state, CONFIG, pool)
    return state.network.state_dict(), state.losses


def killed_after(steps: int, pool: TrainingPictures, path: Path) -> None:
    """Ends without a word after so many steps: only what `checkpoint_every` kept is there."""

    class KilledError(Exception):
        pass

    def die(share: float) -> None:
        if share * CONFIG.steps >= steps - 1e-9:
            raise KilledError

    with pytest.raises(KilledError):
        run_steps(new_state(CONFIG, "cpu"), CONFIG, pool, checkpoint=path, progress=die)


def test_killed_and_resumed_is_the_same_as_never_killed(pool, uninterrupted, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint"
    killed_after(5, pool, path)
    state = load_state(path, CONFIG, "cpu")
    assert state.step == 3 and len(state.losses) == 3
    assert run_steps(state, CONFIG, pool, checkpoint=path)
    weights, losses = uninterrupted
    found = state.network.state_dict()
    assert all(torch.equal(found[name], value) for name, value in weights.items())
    assert state.losses[3:] == losses[3:] and state.losses[:3] == pytest.approx(losses[:3], abs=1e-5)


def test_cancelled_it_keeps_the_step_it_was_at(pool, uninterrupted, tmp_path: Path) -> None:
    path, state = tmp_path / "checkpoint", new_state(CONFIG, "cpu")
    assert not run_steps(state, CONFIG, pool, checkpoint=path, cancelled=lambda: state.step == 4)
    resumed = load_state(path, CONFIG, "cpu")
    assert resumed.step == 4 and run_steps(resumed, CONFIG, pool)
    assert all(torch.equal(resumed.network.state_dict()[name], one) for name, one in uninterrupted[0].items())


def test_an_ended_training_may_go_on_with_fewer_steps_and_says_so(pool, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint"
    killed_after(3, pool, path)
    fewer = dataclasses.replace(CONFIG, steps=5)
    state = load_state(path, fewer, "cpu")
    assert run_steps(state, fewer, pool, checkpoint=path) and state.step == 5 and state.plans == [(0, 7), (3, 5)]
    assert load_state(path, fewer, "cpu").plans == [(0, 7), (3, 5)]


def test_another_seed_is_another_training(pool, uninterrupted) -> None:
    state = new_state(dataclasses.replace(CONFIG, seed=1), "cpu")
    before = {name: value.clone() for name, value in state.network.state_dict().items()}
    assert run_steps(state, dataclasses.replace(CONFIG, seed=1), pool)
    head = "fine.1.weight"
    assert not torch.equal(state.network.state_dict()[head], before[head])
    assert not torch.equal(state.network.state_dict()[head], uninterrupted[0][head])


def test_a_checkpoint_of_other_settings_or_a_damaged_one_is_one_clear_line(pool, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint"
    killed_after(3, pool, path)
    with pytest.raises(ConfigError, match="other settings") as caught:
        load_state(path, dataclasses.replace(CONFIG, batch=3), "cpu")
    assert "\n" not in str(caught.value)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ConfigError, match="not a checkpoint") as caught:
        load_state(path, CONFIG, "cpu")
    assert "\n" not in str(caught.value) and "checkpoint" in str(caught.value)


def test_without_pictures_there_is_nothing_to_train_on() -> None:
    with pytest.raises(ConfigError, match="no pictures"):
        run_steps(new_state(CONFIG, "cpu"), CONFIG, TrainingPictures(()))


def test_the_learning_rate_rises_and_falls_to_nothing() -> None:
    config = DetectorTrainingConfig(steps=1000, warm_up_steps=100, learning_rate=1e-3)
    rates = [learning_rate(config, step) for step in range(1000)]
    assert rates[0] == pytest.approx(1e-5) and max(rates) == pytest.approx(1e-3) == rates[100]
    assert all(a > b for a, b in pairwise(rates[100:])) and rates[-1] < 1e-7
