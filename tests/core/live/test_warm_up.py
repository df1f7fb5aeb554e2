from dataclasses import replace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.chain import RallyChain
from core.chain.control import return_chance
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.events import SensorSize
from core.live.warm_up import Table, _painted, warm_up


@pytest.mark.parametrize("placement", ["side", "ceiling", "behind"])
def test_every_stage_runs_and_nothing_stays(placement) -> None:
    cameras = stereo_preset(placement)
    player = Player(RallyChain(cameras), BuiltInController())
    state = warm_up(player, cameras, 2000)
    assert state is not None and state.chain.point is not None
    assert state.chain.prediction is not None and state.decision is not None
    assert state.chain.prediction.stage == "post", "what happens at a bounce was loaded too"
    assert player.chain.step(_quiet(cameras)).prediction is None


def test_the_painted_ball_flies_a_parabola_and_bounces_off_the_table() -> None:
    """From (0.4, 0.05, 0.12) at 4 m/s along the table and 1.5 down: 0.1 m of fall take 56 ms."""
    camera = stereo_preset("side")["left"]
    for end_us, bounced in ((30_000, False), (80_000, True)):
        t = end_us * 1e-6
        fall = 0.12 - 1.5 * t - 9.81 / 2 * t * t
        assert (fall < 0.02) == bounced
        p = np.array([[0.4 - 4.0 * t, 0.05, 0.04 - fall if bounced else fall]])
        window = _painted(camera, end_us, 2000, Table(1.0, 0.0))
        assert (window.start_us, window.end_us) == (end_us - 2000, end_us)
        events, centre = window.events, camera.project(p)[0]
        assert window.start_us <= events.t_us[0] and events.t_us[-1] < end_us
        radius = camera.K[0, 0] * 0.02 / camera.to_camera(p)[0, 2]
        late = events.between(end_us - 400, end_us)
        off = np.stack([late.x_px.astype(float), late.y_px.astype(float)], axis=1) - centre
        assert len(late) > 10 and np.abs(np.hypot(*off.T) - radius).max() < 2.5, "on its rim"
        ahead = camera.project(p + np.array([-0.004, 0, 0]))[0] - centre
        assert ((off @ ahead > 0) == late.on)[np.abs(off @ ahead) > 0.3 * radius * np.hypot(*ahead)].all()


def _quiet(cameras):
    from core.events import Events, Window

    return {name: Window(Events.empty(camera.sensor), 0, 2000) for name, camera in cameras.items()}


def test_cameras_that_do_not_see_the_ball_do_no_harm() -> None:
    # Turned round: the ball is behind them, and there is no point of the picture that it could be painted at.
    for cameras in (stereo_preset("side", SensorSize(32, 32)), _turned_round(stereo_preset("side"))):
        player = Player(RallyChain(cameras), BuiltInController())
        state = warm_up(player, cameras, 5000)
        assert state is not None and state.decision is None and state.chain.prediction is None
        assert player.chain.step(_quiet(cameras)).prediction is None


def _turned_round(cameras):
    turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    return {name: replace(camera, T_world_camera=camera.T_world_camera @ turn) for name, camera in cameras.items()}


def test_the_chance_of_a_stroke_is_loaded_too_where_the_hit_is_chosen() -> None:
    """Before the first ball: it would stop the player for a second. The painted ball may be too low for a stroke."""
    cameras = stereo_preset()
    warm_up(Player(RallyChain(cameras), BuiltInController(), hit="chosen"), cameras, 5000)
    assert return_chance._slopes.signatures  # pyright: ignore[reportPrivateUsage]
