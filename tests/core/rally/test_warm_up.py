import pytest

from core.cameras import stereo_preset
from core.events import SensorSize
from core.rally import RallyChain
from core.rally.controller import BuiltInController
from core.rally.player import Player
from core.rally.warm_up import warm_up


@pytest.mark.parametrize("placement", ["side", "ceiling", "behind"])
def test_every_stage_runs_and_nothing_stays(placement) -> None:
    cameras = stereo_preset(placement)
    player = Player(RallyChain(cameras), BuiltInController())
    state = warm_up(player, cameras, 2000)
    assert state is not None and state.chain.point is not None
    assert state.chain.prediction is not None and state.command is not None
    assert state.chain.prediction.stage == "post", "what happens at a bounce was loaded too"
    assert player.chain.step(_quiet(cameras)).prediction is None


def _quiet(cameras):
    from core.events import Events, Window

    return {name: Window(Events.empty(camera.sensor), 0, 2000) for name, camera in cameras.items()}


def test_cameras_that_do_not_see_the_ball_do_no_harm() -> None:
    cameras = stereo_preset("side", SensorSize(32, 32))
    warm_up(Player(RallyChain(cameras), BuiltInController()), cameras, 5000)
