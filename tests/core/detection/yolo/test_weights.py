import dataclasses
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from core.detection.yolo.config import YoloConfig
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import SharpScore, YoloWeights, load_weights, save_weights
from core.errors import ConfigError

CONFIG = YoloConfig(input_width_px=320, input_height_px=256, width=0.125, confidence=0.35)
SCORE = SharpScore(recall=0.95, precision=0.99, median_error_px=0.6, pictures=100, seed=3)


@pytest.fixture
def weights() -> YoloWeights:
    torch.manual_seed(1)
    return YoloWeights(YoloTiny(CONFIG.width).eval(), CONFIG, SCORE, {"seed": 1, "steps": 5})


def test_what_is_written_comes_back_with_half_the_digits(weights, tmp_path: Path) -> None:
    save_weights(tmp_path / "w", weights)
    found = load_weights(tmp_path / "w")
    assert (found.config, found.score, found.training) == (CONFIG, SCORE, {"seed": 1, "steps": 5})
    before, after = weights.network.state_dict(), found.network.state_dict()
    assert before.keys() == after.keys()
    for name, value in before.items():
        torch.testing.assert_close(after[name].to(value.dtype), value, rtol=1e-3, atol=1e-7)
    picture = torch.rand(1, 3, 64, 64)
    for one, other in zip(weights.network(picture), found.network(picture), strict=True):
        torch.testing.assert_close(one, other, rtol=0.05, atol=0.02)
    assert not found.network.training


def test_the_published_size_is_below_25_megabytes(tmp_path: Path) -> None:
    save_weights(tmp_path / "w", YoloWeights(YoloTiny(), YoloConfig(), None, {}))
    assert (tmp_path / "w").stat().st_size < 12.5e6
    assert load_weights(tmp_path / "w").score is None


def test_a_network_without_a_score_is_no_rival_and_one_that_misses_sharp_balls_neither(weights) -> None:
    assert SCORE.is_rival and not dataclasses.replace(SCORE, recall=0.89).is_rival


def damage(path: Path, how: str) -> None:
    data = path.read_bytes()
    match how:
        case "cut off":
            path.write_bytes(data[: len(data) // 2])
        case "no safetensors":
            path.write_bytes(b"\x80\x04 a pickle, say")
        case "empty":
            path.write_bytes(b"")
        case "of something else":
            save_file({"a": torch.zeros(3)}, path)
        case "of another network":
            config = dataclasses.replace(CONFIG, width=0.25)
            save_weights(path, YoloWeights(YoloTiny(CONFIG.width), config, None, {}))
        case "gone":
            path.unlink()


@pytest.mark.parametrize(
    "how", ["cut off", "no safetensors", "empty", "of something else", "of another network", "gone"]
)
def test_a_file_that_cannot_be_used_is_one_clear_line(weights, tmp_path: Path, how: str) -> None:
    path = tmp_path / "weights.safetensors"
    save_weights(path, weights)
    damage(path, how)
    with pytest.raises(ConfigError) as caught:
        load_weights(path)
    text = str(caught.value)
    assert "\n" not in text and "weights.safetensors" in text and "rallyscope train-detector yolo" in text
