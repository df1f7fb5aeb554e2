import numpy as np
import pytest

from core.detection import Detection, ReferenceDetector
from core.events import Events, SensorSize, Window
from tests.core.detection.fast.exactness import WINDOW_US, compare_detectors, random_config, random_windows

pytestmark = pytest.mark.numeric


class Says:
    """Answers from a list."""

    def __init__(self, *answers: Detection | None, extra_circles: int = 0) -> None:
        self._answers = list(answers)
        self.extra_circles = extra_circles

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        return self._answers.pop(0)


EMPTY = [Window(Events.empty(SensorSize(4, 4)), 0, 10)]


def test_a_missing_answer_a_shifted_one_and_other_circles_differ() -> None:
    here, near, far = (Detection(10, u, 2.0, 3.0) for u in (1.0, 1.0005, 1.002))
    assert compare_detectors(Says(here), Says(here), EMPTY).differing == 0
    assert compare_detectors(Says(here), Says(near), EMPTY).differing == 0
    assert compare_detectors(Says(here), Says(far), EMPTY).differing == 1
    assert compare_detectors(Says(here), Says(None), EMPTY).differing == 1
    assert compare_detectors(Says(None), Says(here), EMPTY).differing == 1
    assert compare_detectors(Says(here), Says(here, extra_circles=1), EMPTY).differing == 1


def test_the_random_windows_look_for_trouble() -> None:
    rng = np.random.default_rng(0)
    windows = [window for _ in range(60) for window in random_windows(10, rng)]
    sizes = {(window.events.sensor.width_px, window.events.sensor.height_px) for window in windows}
    assert any(1 in size for size in sizes) and any(min(size) > 64 for size in sizes)
    assert any(not len(window.events) for window in windows)
    on_border = [w for w in windows if len(w.events) and (w.events.x_px == w.events.sensor.width_px - 1).any()]
    repeated = [w for w in windows if len(w.events) > len(np.unique(w.events.x_px * 1000.0 + w.events.y_px))]
    assert len(on_border) > 20 and len(repeated) > 20
    assert all(window.end_us - window.start_us == WINDOW_US for window in windows)


def test_the_random_configs_reach_every_stage() -> None:
    rng = np.random.default_rng(0)
    configs = [random_config(rng) for _ in range(60)]
    assert {config.polarity.leading_polarity for config in configs} == {"auto", "on", "off"}
    assert {config.denoise.kernel_px for config in configs} == {1, 3, 5, 7, 9}
    assert any(config.flicker.enabled for config in configs) and any(config.hot_pixels.enabled for config in configs)
    found = sum(
        ReferenceDetector(config).step(window) is not None for config in configs for window in random_windows(3, rng)
    )
    assert found > 10
