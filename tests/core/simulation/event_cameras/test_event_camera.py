"""The camera as a whole: against a dense simulation of every pixel, and its laws."""

import numpy as np
import pytest

from core.errors import ConfigError
from core.events import Events, concatenate_events
from core.simulation import SceneConfig, SensorConfig, scene_named
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights import ParabolicPath
from core.simulation.scenes.background import LOG_LIGHT, make_background
from core.simulation.scenes.block_view import moving_steps
from tests.core.simulation.dense_sensor import compare_events, dense_events

pytestmark = pytest.mark.numeric


def quiet(**settings) -> SensorConfig:
    return SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0, **settings)


def simulate(camera, scene, config, path, end_us, seed=1, chunk_us=BLOCK_US) -> Events:
    rig = EventCamera(camera, scene, config, np.random.default_rng(seed))
    parts = [rig.advance(path, end) for end in range(chunk_us, end_us + 1, chunk_us)]
    return concatenate_events(parts, camera.sensor)


@pytest.mark.parametrize("scene_name", ["ball", "dark"])
def test_culling_and_substeps_agree_with_a_dense_simulation(small_camera, crossing, scene_name) -> None:
    scene, config, end_us = scene_named(scene_name), quiet(), 30_000
    dense = dense_events(small_camera, scene, config, crossing, end_us, seed=1)
    events = simulate(small_camera, scene, config, crossing, end_us)
    assert len(dense.t_us) > 2_000
    for found in compare_events(events, dense).values():
        assert found.ratio == pytest.approx(1.0, abs=0.1) and found.ks <= 0.05
    width = small_camera.sensor.width_px
    assert np.mean(events.x_px) == pytest.approx(np.mean(dense.pixel % width), abs=0.3)
    assert np.mean(events.y_px) == pytest.approx(np.mean(dense.pixel // width), abs=0.3)


def test_a_bright_ball_leads_with_on_and_a_dark_one_with_off(small_camera, crossing) -> None:
    for name, leads_on in (("ball", True), ("dark", False)):
        events = simulate(small_camera, scene_named(name), quiet(), crossing, 30_000)
        window = events.between(18_000, 20_000)
        centre_u = small_camera.project(crossing.at([0.019]).p_world_m)[0, 0]
        later_u = small_camera.project(crossing.at([0.020]).p_world_m)[0, 0]
        ahead = (window.x_px.astype(float) - centre_u) * np.sign(later_u - centre_u)
        near = np.abs(ahead) < 14
        assert (ahead[near & window.on].mean() > ahead[near & ~window.on].mean()) == leads_on


def test_nothing_moves_and_no_noise_means_no_events(small_camera, crossing) -> None:
    gone = type(crossing)(np.array([5.0]), crossing.p_world_m, crossing.v_world_mps, crossing.spin_radps, 6.0)
    assert len(simulate(small_camera, SceneConfig(), quiet(), gone, 50_000)) == 0


def test_nobody_can_write_into_the_events(small_camera, crossing) -> None:
    events = EventCamera(small_camera, SceneConfig(), quiet(), np.random.default_rng(1)).advance(crossing, BLOCK_US)
    assert len(events)
    for column in (events.t_us, events.x_px, events.y_px, events.on):
        with pytest.raises(ValueError, match="read-only"):
            column[0] = column[0]


def test_a_soft_shadow_is_looked_at_more_seldom_than_the_ball(small_camera) -> None:
    """The higher the ball, the softer its shadow; on the table both have the same edge."""

    def strides(height_m: float) -> list[int]:
        start, velocity = np.array([[0.8, 0.0, height_m]]), np.array([[-4.0, 0.0, 0.0]])
        path = ParabolicPath(np.array([-0.2]), start, velocity, np.zeros((1, 3)), 1.0, 0.0)
        steps = moving_steps(small_camera, SceneConfig(), path, None, 0, BLOCK_US)
        assert steps is not None
        return steps.strides.tolist()

    low, high = strides(0.1), strides(0.25)
    assert low[0] == high[0] == 1, "the ball, every time"
    assert 1 < low[1] < high[1] <= 8


def test_the_noise_has_its_rate_and_its_share_of_on(small_camera, crossing) -> None:
    config = SensorConfig(noise_hz=5.0, hot_pixels_per_million=0.0)
    gone = type(crossing)(np.array([50.0]), crossing.p_world_m, crossing.v_world_mps, crossing.spin_radps, 60.0)
    events = simulate(small_camera, SceneConfig(), config, gone, 1_000_000, chunk_us=100_000)
    expected = 5.0 * 96 * 72
    assert len(events) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    on_share = config.leak_share + (1 - config.leak_share) / 2
    assert events.on.mean() == pytest.approx(on_share, abs=5 * np.sqrt(0.25 / expected))


def test_no_pixel_fires_within_its_refractory_time(small_camera, crossing) -> None:
    config = SensorConfig(noise_hz=5.0, refractory_us=300)
    events = simulate(small_camera, SceneConfig(), config, crossing, 30_000)
    address = events.y_px.astype(int) * 96 + events.x_px
    order = np.lexsort((events.t_us, address))
    same = np.diff(address[order]) == 0
    assert same.any() and np.diff(events.t_us[order])[same].min() >= 299  # whole microseconds


def test_the_same_seed_gives_the_same_events_however_they_are_cut(small_camera, crossing) -> None:
    config = SensorConfig(noise_hz=2.0)
    whole = simulate(small_camera, SceneConfig(), config, crossing, 60_000, chunk_us=60_000)
    parts = simulate(small_camera, SceneConfig(), config, crossing, 60_000, chunk_us=10_000)
    other = simulate(small_camera, SceneConfig(), config, crossing, 60_000, seed=2)
    for column in ("t_us", "x_px", "y_px", "on"):
        assert np.array_equal(getattr(whole, column), getattr(parts, column))
    assert len(other) != len(whole) or not np.array_equal(other.t_us, whole.t_us)
    assert not whole.t_us.flags.writeable and np.all(np.diff(whole.t_us) >= 0)


def test_time_is_asked_for_in_order_and_in_whole_blocks(small_camera, crossing) -> None:
    rig = EventCamera(small_camera, SceneConfig(), quiet(), np.random.default_rng(0))
    rig.advance(crossing, 2 * BLOCK_US)
    for end_us in (BLOCK_US, 2 * BLOCK_US, 2 * BLOCK_US + 1):
        with pytest.raises(ConfigError, match="cannot simulate to this time"):
            rig.advance(crossing, end_us)


def test_the_background_is_seen_where_no_ball_is(small_camera) -> None:
    light = make_background(small_camera, SceneConfig())[:, LOG_LIGHT]
    assert np.isfinite(light).all() and light.std() > 0.05


def test_a_flickering_lamp_agrees_with_a_dense_simulation(small_camera, crossing) -> None:
    scene, config, end_us = SceneConfig(flicker=0.25), quiet(), 30_000
    dense = dense_events(small_camera, scene, config, crossing, end_us, seed=1)
    events = simulate(small_camera, scene, config, crossing, end_us)
    assert len(dense.t_us) > 3 * 96 * 72  # every pixel, in every swing
    for found in compare_events(events, dense).values():
        assert found.ratio == pytest.approx(1.0, abs=0.1) and found.ks <= 0.05


def test_flicker_below_the_threshold_makes_no_events_of_its_own(small_camera, crossing) -> None:
    gone = type(crossing)(np.array([5.0]), crossing.p_world_m, crossing.v_world_mps, crossing.spin_radps, 6.0)
    config = quiet(threshold_mismatch=0.0)
    assert len(simulate(small_camera, SceneConfig(flicker=0.08), config, gone, 50_000)) == 0
    assert len(simulate(small_camera, SceneConfig(flicker=0.3), config, gone, 50_000)) > 5 * 96 * 72
