from dataclasses import replace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.events import SensorSize
from core.rally import RallyChain
from core.rally.control.controller import BuiltInController
from core.rally.control.player import Player
from core.rally.live.warm_up import warm_up


@pytest.mark.parametrize("placement", ["side", "ceiling", "behind"])
def test_every_stage_runs_and_nothing_stays(placement) -> None:
    cameras = stereo_preset(placement)
    player = Player(RallyChain(cameras), BuiltInController())
    state = warm_up(player, cameras, 2000)
    assert state is not None and state.chain.point is not None
    assert state.chain.prediction is not None and state.decision is not None
    assert state.chain.prediction.stage == "post", "what happens at a bounce was loaded too"
    assert player.chain.step(_quiet(cameras)).prediction is None


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
