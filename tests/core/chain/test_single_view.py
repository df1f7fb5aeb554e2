"""One camera alone carries a flight on, and one that sees seldom or late still helps."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from core.cameras import Camera
from core.cameras.presets import camera_preset
from core.chain import ChainConfig, ChainState, RallyChain
from core.chain.config import SingleViewConfig, SizeCheckConfig
from core.detection import Detection, register_detector
from core.events import Events, SensorSize, Window
from core.registry import forgotten_afterwards
from core.trajectory.ball_kernel import fly_and_bounce
from core.trajectory.filter_config import refined_filter

pytestmark = pytest.mark.numeric
CAMERAS = camera_preset("corners")
START = np.array([0.9, 0.1, 0.3, -6.0, 0.3, 0.5, 0, 0, 0, 0.0, 0.9, 0.15, 0.0, 0.0])
EVENTS: Final = 16
"""In a window: their mean is the ball, to a sixteenth of a pixel."""


class MeanDetector:
    """The mean of all events, at the time of the last one."""

    extra_circles = 0

    def __init__(self, config: object, sensor: SensorSize) -> None: ...

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        events = window.events
        if not len(events):
            return None
        return Detection(int(events.t_us[-1]), float(events.x_px.mean()), float(events.y_px.mean()), 8.0)


@pytest.fixture(autouse=True)
def mean_detector() -> Iterator[None]:
    with forgotten_afterwards():
        register_detector("mean", MeanDetector, None, "the mean of all events", (1, 2, 3), stages=("denoise",))
        yield


def chain_of(names: tuple[str, ...], **single_view: float) -> RallyChain:
    config = ChainConfig(
        method="mean",
        size=SizeCheckConfig(enabled=False),
        filter=refined_filter(),
        single_view=SingleViewConfig(**{"floor_px": 0.1, **single_view}),  # pyright: ignore[reportArgumentType]
    )
    triangulation = replace(config.triangulation, sigma_px=0.1)
    return RallyChain({name: CAMERAS[name] for name in names}, replace(config, triangulation=triangulation))


def place(t_ms: float) -> np.ndarray:
    x = START.copy()
    fly_and_bounce(x, 1e-3 * t_ms, 0.0)
    return x[:3]


def window(camera: Camera, k: int, t_ms: float | None, away_px: float = 0.0) -> Window:
    """[k, k + 1) ms; empty without a time at which the ball was seen."""
    if t_ms is None:
        return Window(Events.empty(camera.sensor), 1000 * k, 1000 * (k + 1))
    u, v = camera.project(place(t_ms)[None])[0] + away_px
    x, y = (np.floor(value + np.arange(EVENTS) / EVENTS).astype(np.uint16) for value in (u, v))
    t_us = np.full(EVENTS, round(1000 * t_ms))
    return Window(Events.from_columns(t_us, x, y, x > 0, camera.sensor), 1000 * k, 1000 * (k + 1))


def follow(chain: RallyChain, seen, last_ms: int = 300) -> list[ChainState]:
    """`seen(name, k)`: when in the window of so many ms the camera saw the ball, or None."""
    return [
        chain.step({name: window(CAMERAS[name], k, seen(name, k)) for name in chain.rig.names})
        for k in range(1, last_ms)
    ]


def test_one_camera_carries_a_flight_on_for_100_ms_and_says_how_well() -> None:
    def seen(name: str, k: int) -> float | None:
        return k if k < 50 or name == "near_left" or k >= 200 else None

    states = follow(chain_of(tuple(CAMERAS)), seen, 230)
    lone = [state.point for state in states if state.point is not None and len(state.point.uvs_px) == 1]
    times = np.array([point.t_us for point in lone])
    assert all(point.uvs_px.keys() == {"near_left"} for point in lone)
    assert len(times) > 85 and times[-1] == 149_000, "100 ms after the last point of several"
    assert np.diff(times).max() < 20_000, "left out round the bounce only"
    misses = np.array([point.p_world_m - place(1e-3 * point.t_us) for point in lone])
    sigmas = np.array([np.sqrt(np.trace(point.covariance_m2)) for point in lone])
    assert np.linalg.norm(misses, axis=1).max() < 0.005
    assert (np.linalg.norm(misses, axis=1) < 3 * sigmas).all() and sigmas[-1] > 1.5 * sigmas[0]
    assert all(state.verdict == "same flight" for state in states[1:148] if state.point is not None)
    assert max(state.t_us for state in states if state.is_new and state.t_us < 200_000) > 140_000, "predictions go on"
    assert states[-1].point is not None and len(states[-1].point.uvs_px) == 4


def covariance_alone(**single_view: float) -> np.ndarray:
    """(3, 3) stated 40 ms after the other cameras went blind."""
    chain = chain_of(tuple(CAMERAS), **single_view)
    point = follow(chain, lambda name, k: k if k < 50 or name == "near_left" else None, 91)[-1].point
    assert point is not None and len(point.uvs_px) == 1
    return point.covariance_m2


def test_what_all_points_err_alike_is_upwards_and_along_the_flight_only() -> None:
    filters_own = covariance_alone(offset_mm=0.0, offset_mmps=0.0, delay_us=0.0)
    upwards = covariance_alone(offset_mm=0.5, offset_mmps=0.0, delay_us=0.0) - filters_own
    assert upwards == pytest.approx(np.diag([0.0, 0.0, 0.25e-6]), abs=1e-12)
    later = covariance_alone(offset_mm=0.0, offset_mmps=10.0, delay_us=0.0) - filters_own
    assert later == pytest.approx(np.diag([0.0, 0.0, (10e-3 * 0.041) ** 2]), rel=0.1, abs=1e-12)


def test_a_delay_counts_by_the_speed_as_far_as_the_filter_does_not_know_it() -> None:
    filters_own = covariance_alone(offset_mm=0.0, offset_mmps=0.0, delay_us=0.0)
    slow = covariance_alone(offset_mm=0.0, offset_mmps=0.0, delay_us=40.0)
    assert np.array_equal(slow, filters_own), "0.24 mm at 6 m/s, of which the filter expects 0.3"
    fast = covariance_alone(offset_mm=0.0, offset_mmps=0.0, delay_us=100.0) - filters_own
    x = START.copy()
    fly_and_bounce(x, 0.09, 0.0)
    along = x[3:6] / np.linalg.norm(x[3:6])
    assert along @ fast @ along == pytest.approx((100e-6 * np.linalg.norm(x[3:6])) ** 2 - 0.0003**2, rel=0.02)
    assert np.trace(fast) == pytest.approx(along @ fast @ along, rel=1e-3)


@pytest.mark.parametrize(
    ("names", "settings"),
    [(tuple(CAMERAS), {"least_cameras": 5}), (("near_left", "far_right"), {}), (tuple(CAMERAS), {"longest_ms": 0.0})],
)
def test_without_it_there_are_points_of_several_cameras_only(names, settings) -> None:
    states = follow(chain_of(names, **settings), lambda name, k: k if k < 50 or name == "near_left" else None, 100)
    points = [state.point for state in states if state.point is not None]
    assert len(points) > 40 and min(len(point.uvs_px) for point in points) > 1


def test_what_one_of_two_cameras_sees_alone_is_not_kept() -> None:
    chain = chain_of(("near_left", "far_right"))
    follow(chain, lambda name, k: k if name == "near_left" else None, 200)
    assert len(chain._common_time._waiting) <= 2


def test_two_cameras_may_be_told_to_use_it() -> None:
    chain = chain_of(("near_left", "far_right"), least_cameras=2)
    states = follow(chain, lambda name, k: k if k < 50 or name == "near_left" else None, 100)
    assert sum(state.point is not None and len(state.point.uvs_px) == 1 for state in states) > 20


def test_something_else_in_the_one_camera_moves_nothing() -> None:
    chain = chain_of(tuple(CAMERAS))
    follow(chain, lambda name, k: k, 50)
    for k in range(50, 70):
        away_px = 25.0 if k % 2 else 0.0
        windows = {n: window(CAMERAS[n], k, k if n == "near_left" else None, away_px) for n in CAMERAS}
        point = chain.step(windows).point
        if point is not None:
            assert point.t_us % 2000 == 0
            assert np.linalg.norm(point.p_world_m - place(1e-3 * point.t_us)) < 0.002


def test_of_two_cameras_that_see_different_things_the_one_that_fits_the_flight_counts() -> None:
    chain = chain_of(tuple(CAMERAS))
    follow(chain, lambda name, k: k, 50)
    for k in range(50, 80):
        windows = {
            name: window(camera, k, k if name.startswith("near") else None, 60.0 * (name == "near_right"))
            for name, camera in CAMERAS.items()
        }
        point = chain.step(windows).point
        assert point is not None and point.uvs_px.keys() == {"near_left"}


def sigma_of_bounce(seen, late_ms: int = 0) -> float:
    """Stated error along x of the coming bounce after 60 ms; the third camera's windows come so much later."""
    names = ("near_left", "near_right", "far_left")
    chain = chain_of(names)
    predictions = []
    for k in range(1, 61):
        predictions.append(chain.step({name: window(CAMERAS[name], k, float(k)) for name in names[:2]}).prediction)
        if k > late_ms:
            chain.step({names[2]: window(CAMERAS[names[2]], k - late_ms, seen(k - late_ms))})
    assert predictions[-1] is not None
    return float(predictions[-1].bounces[0].sigma_m[0])


def test_a_third_camera_that_sees_seldom_or_answers_late_still_helps() -> None:
    never = sigma_of_bounce(lambda k: None)
    seldom = sigma_of_bounce(lambda k: k + 0.4 if k % 10 == 0 else None)
    late = sigma_of_bounce(lambda k: k + 0.4, late_ms=4)
    assert seldom < 0.99 * never
    assert late < 0.95 * never


OFF_PX: Final = 0.6


def misses_with(distrusted: str | None, cameras: tuple[str, ...] = tuple(CAMERAS)) -> tuple[list[float], list[float]]:
    """Errors in m, and the stated ones, while far_left sees everything a little beside its place."""
    chain = chain_of(cameras)
    chain.distrust(distrusted, OFF_PX)
    misses, stated = [], []
    for k in range(1, 60):
        windows = {name: window(CAMERAS[name], k, k, OFF_PX * (name == "far_left")) for name in cameras}
        point = chain.step(windows).point
        assert point is not None and set(point.uvs_px) == set(cameras)
        misses.append(float(np.linalg.norm(point.p_world_m - place(1e-3 * point.t_us))))
        stated.append(float(np.sqrt(np.trace(point.covariance_m2))))
    return misses, stated


def test_a_distrusted_camera_decides_less_where_others_see_the_ball_too() -> None:
    believed, distrusted = misses_with(None)[0], misses_with("far_left")[0]
    assert np.median(distrusted) < 0.4 * np.median(believed)
    assert np.median(misses_with("near_left")[0]) > np.median(believed)


def test_beside_one_other_it_is_used_and_says_how_badly_the_place_is_known() -> None:
    pair = ("near_left", "far_left")
    believed, stated = misses_with(None, pair)
    distrusted, stated_of_it = misses_with("far_left", pair)
    assert distrusted == believed
    assert np.median(stated) < 0.6 * np.median(believed) < 0.6 * np.median(stated_of_it)


def test_nobody_is_distrusted_after_a_reset() -> None:
    chain = chain_of(tuple(CAMERAS))
    chain.distrust("far_left", OFF_PX)
    chain.reset()

    def point(which: RallyChain) -> bytes:
        found = which.step({name: window(CAMERAS[name], 1, 1, name == "far_left") for name in CAMERAS}).point
        assert found is not None
        return found.p_world_m.tobytes() + found.covariance_m2.tobytes()

    assert point(chain) == point(chain_of(tuple(CAMERAS)))


def test_a_distrusted_camera_that_is_alone_moves_the_flight_less() -> None:
    sigmas = []
    for off_px in (0.0, OFF_PX):
        chain = chain_of(tuple(CAMERAS))
        chain.distrust("near_left", off_px)
        point = follow(chain, lambda name, k: k if k < 50 or name == "near_left" else None, 91)[-1].point
        assert point is not None and point.uvs_px.keys() == {"near_left"}
        sigmas.append(np.sqrt(np.trace(point.covariance_m2)))
    assert sigmas[1] > 1.05 * sigmas[0]
