import numpy as np
import pytest

from core.config import replace_setting
from core.detection import (
    FastDetector,
    ReferenceDetector,
    TrackState,
    auto_config,
    paper_config,
    trace_window,
)
from core.events import SensorSize
from tests.core.detection.fast.exactness import compare_detectors, compare_random

pytestmark = pytest.mark.numeric


def with_all_stages():
    config = replace_setting(auto_config(), ("hot_pixels", "enabled"), True)
    return replace_setting(config, ("flicker", "enabled"), True)


CONFIGS = {
    "auto": auto_config(),
    "paper": paper_config(),
    "off": replace_setting(auto_config(), ("polarity", "leading_polarity"), "off"),
    "all stages": with_all_stages(),
    "time counts": replace_setting(auto_config(), ("cluster", "time_scale_px_per_ms"), 1.5),
    "no denoising": replace_setting(auto_config(), ("denoise", "kernel_px"), 1),
    "no region": replace_setting(auto_config(), ("roi", "enabled"), False),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_it_answers_as_the_reference_on_live_flights(name: str, make_scene, make_flight) -> None:
    scenes = [
        make_scene(make_flight(du_px_per_ms=2.5), duration_us=120_000, noise_hz=1),
        make_scene(
            make_flight(v_px=3, dv_px_per_ms=0),
            make_flight(u_px=300, du_px_per_ms=-2, bright=False, r_px=7),
            duration_us=120_000,
            noise_hz=5,
            seed=1,
        ),
        make_scene(make_flight(r_px=5, v_px=4, dv_px_per_ms=0), sensor=SensorSize(129, 9), noise_hz=200, seed=3),
    ]
    config = CONFIGS[name]
    detections = 0
    for scene in scenes:
        agreement = compare_detectors(ReferenceDetector(config), FastDetector(config), scene.windows())
        assert agreement.differing == 0
        detections += agreement.detections
    assert detections > 60


def test_it_answers_as_the_reference_on_random_windows_with_random_configs() -> None:
    agreement = compare_random(60, 12, np.random.default_rng(5))
    assert agreement.differing == 0 and agreement.detections > 40


def test_its_state_continues_in_the_readable_pipeline_and_back(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=5).windows()
    config = with_all_stages()
    straight, resumed = FastDetector(config), FastDetector(config)
    for window in windows[:20]:
        straight.step(window)
        resumed.step(window)
    trace = trace_window(windows[20], resumed.state, config)
    resumed.resume(trace.state)
    here = straight.step(windows[20])
    assert here is not None and trace.detection is not None
    assert here.u_px == pytest.approx(trace.detection.u_px, abs=1e-3)
    assert [straight.step(window) for window in windows[21:30]] == [resumed.step(window) for window in windows[21:30]]


def test_a_state_that_was_handed_out_does_not_change(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=50).windows()
    detector = FastDetector(with_all_stages())
    for window in windows[:10]:
        detector.step(window)
    state = detector.state
    assert state.hot_pixels is not None and state.flicker is not None
    before = state.hot_pixels.score.copy(), state.flicker.risen_us.copy()
    for window in windows[10:20]:
        detector.step(window)
    assert np.array_equal(state.hot_pixels.score, before[0]) and np.array_equal(state.flicker.risen_us, before[1])


def test_windows_of_more_events_than_expected_get_more_room(make_scene) -> None:
    scene = make_scene(noise_hz=200, duration_us=8000)
    assert len(scene.windows()[0].events) > 20_000
    config = replace_setting(paper_config(), ("cluster", "size_max"), 200_000)
    assert compare_detectors(ReferenceDetector(config), FastDetector(config), scene.windows()).differing == 0


def test_a_fresh_one_begins_on_the_whole_sensor() -> None:
    assert FastDetector(auto_config()).state.centre_px is TrackState().centre_px is None
