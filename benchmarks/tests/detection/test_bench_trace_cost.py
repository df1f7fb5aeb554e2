"""The detector without hooks is the default method, and the benchmark times all three variants."""

import numpy as np

from benchmarks.detection.bench_trace_cost import detector_without_hooks, measure_costs
from core.config import get_section
from core.detection import RefinedDetector, refined_config
from core.events import Events, SensorSize, Window

SENSOR = SensorSize(160, 120)


def disc_windows() -> list[Window]:
    """A disc of 10 px that moves at 2 px/ms: ON events on its front, OFF events behind."""
    rng, windows = np.random.default_rng(0), []
    for start_us in range(0, 40_000, 1000):
        t = np.sort(rng.integers(start_us, start_us + 1000, 160))
        angle = rng.uniform(-np.pi, np.pi, 160)
        x, y = 20 + 2e-3 * t + 10 * np.cos(angle), 60 + 10 * np.sin(angle)
        events = Events.from_columns(t, x.round().astype(int), y.round().astype(int), np.cos(angle) > 0, SENSOR)
        windows.append(Window(events, start_us, start_us + 1000))
    return windows


def test_the_detector_without_hooks_answers_as_the_one_with_them() -> None:
    config, windows = get_section(refined_config(), "refined"), disc_windows()
    plain, stripped = RefinedDetector(config, SENSOR), detector_without_hooks()(config, SENSOR)
    answers = [plain.step(window) for window in windows]
    assert [stripped.step(window) for window in windows] == answers
    assert sum(one is not None for one in answers) > 10


def test_each_variant_has_its_row() -> None:
    rows = measure_costs(disc_windows(), SENSOR, 1)
    assert list(rows) == ["without hooks", "step", "trace"]
    assert rows["without hooks"]["ratio_p50"] == 1.0 and all(row["p50_us"] > 0 for row in rows.values())
