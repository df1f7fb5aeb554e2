from dataclasses import replace

import numpy as np
import pytest

from core.cameras import StereoRig, ball_circles, stereo_preset
from core.chain import ChainConfig, ChainState, RallyChain
from core.chain.config import SizeCheckConfig
from core.chain.size_check import SizeCheck
from core.detection.window import windows_between
from core.events import Window, concatenate_events
from core.simulation import LaunchConfig, StereoConfig, ball_truth, draw_serve_series, simulate_stereo

pytestmark = pytest.mark.numeric
END_US = 400_000


@pytest.fixture(scope="module")
def cameras():
    return stereo_preset()


@pytest.fixture(scope="module")
def shadowed(cameras):
    """A serve at 8 m/s whose shadow one detector takes for the ball after the bounce; its path and its windows."""
    path = draw_serve_series([LaunchConfig(speed_mps=8.0)], np.random.default_rng(5))
    chunks = list(simulate_stereo(StereoConfig(), cameras, path, seed=5, duration_us=END_US))
    windows = []
    for name in cameras:
        events = concatenate_events([chunk.events[name] for chunk in chunks], sensor=cameras[name].sensor)

        class Source:
            def slice(self, start_us: int, end_us: int, events=events):
                rows = np.searchsorted(events.t_us, [start_us, end_us])
                return events.rows(slice(*rows))

        windows.append(list(windows_between(Source(), 0, END_US, 2000)))
    return path, [dict(zip(cameras, row, strict=True)) for row in zip(*windows, strict=True)]


def follow(cameras, windows: list[dict[str, Window]], config: ChainConfig) -> list[ChainState]:
    chain = RallyChain(cameras, config)
    return [chain.step(one) for one in windows]


def errors_m(path, states: list[ChainState]) -> np.ndarray:
    points = [state.point for state in states if state.point is not None]
    truth = ball_truth(path, [point.t_us for point in points]).p_world_m
    return np.linalg.norm(np.array([point.p_world_m for point in points]) - truth, axis=1)


def test_radii_of_a_ball_at_the_point_pass_and_others_do_not(cameras) -> None:
    check = SizeCheck(cameras, StereoRig(cameras), SizeCheckConfig())
    p = np.array([-0.9, 0.3, 0.2])
    radii = {name: float(ball_circles(camera, p[None]).r_px[0]) for name, camera in cameras.items()}
    assert check.wrong(p, radii) == []
    assert check.wrong(p, {**radii, "right": 0.6 * radii["right"]}) == ["right"]
    assert check.wrong(p, {**radii, "left": 2.0 * radii["left"]}) == ["left"]
    assert check.wrong(p, {}) == []


def test_after_as_many_failures_in_a_row_as_its_patience_a_detector_begins_anew(cameras) -> None:
    class Counting:
        extra_circles = 0
        resets = 0

        def reset(self) -> None:
            self.resets += 1

        def step(self, window: Window) -> None:
            return None

    check = SizeCheck(cameras, StereoRig(cameras), SizeCheckConfig(patience=3))
    detectors = {"left": Counting(), "right": Counting()}
    resets = []
    for _ in range(7):
        check.give_up(["left"], detectors)
        resets.append(detectors["left"].resets)
    assert resets == [0, 0, 1, 1, 1, 2, 2] and detectors["right"].resets == 0
    check.reset()
    check.give_up(["left", "right"], detectors)
    check.give_up(["left", "right"], detectors)
    assert (detectors["left"].resets, detectors["right"].resets) == (2, 0)
    check.give_up(["right"], detectors)
    assert (detectors["left"].resets, detectors["right"].resets) == (2, 1)


def test_the_limits_of_a_size_are_shares_of_the_radius_that_a_ball_has_there(cameras) -> None:
    """A ball straight ahead at a depth d has the radius f R / d in the picture."""
    camera = cameras["left"]
    p = camera.position_world_m + 2.5 * camera.T_world_camera[:3, 2]
    radius = camera.K[0, 0] * 0.02 / 2.5
    check = SizeCheck(cameras, StereoRig(cameras), SizeCheckConfig(smallest=0.75, largest=1.7))
    for ratio, wrong in ((0.749, True), (0.751, False), (1.699, False), (1.701, True)):
        assert check.wrong(p, {"left": ratio * radius}) == (["left"] if wrong else [])


@pytest.mark.gate
def test_the_ball_s_shadow_is_not_taken_for_the_ball(cameras, shadowed) -> None:
    path, windows = shadowed
    chain = ChainConfig.of_method("auto")
    without = errors_m(path, follow(cameras, windows, replace(chain, size=SizeCheckConfig(enabled=False))))
    checked = errors_m(path, follow(cameras, windows, chain))
    assert np.percentile(without, 95) > 0.05, "otherwise this serve tests nothing"
    assert checked.max() < 0.04 and np.median(checked) < 0.006
    assert len(checked) > 0.85 * len(without)


def test_a_corrected_circle_is_the_one_that_is_shown(cameras, shadowed) -> None:
    _, windows = shadowed
    for state in follow(cameras, windows, ChainConfig.of_method("auto")):
        if state.point is not None:
            for name, found in state.detections.items():
                if found is not None and found.t_us == state.point.t_us:
                    assert state.point.uvs_px[name] == (found.u_px, found.v_px)


def test_the_paper_s_detector_runs_without_it(cameras, shadowed) -> None:
    _, windows = shadowed
    on = follow(cameras, windows, ChainConfig.of_method("paper"))
    off = follow(cameras, windows, replace(ChainConfig.of_method("paper"), size=SizeCheckConfig(enabled=False)))
    assert [state.detections for state in on] == [state.detections for state in off]
