from pathlib import Path

import numpy as np
import pytest

from core.cameras.presets import SENSOR_720
from core.detection.window import windows_between
from core.events import Events, Window
from core.rally import RallyChain
from core.rally.chain import ChainState
from core.rally.controller import BuiltInController
from core.rally.follow import calibrated_cameras
from core.recordings import open_recording


@pytest.fixture(scope="module")
def followed(serve_recording: Path) -> tuple[RallyChain, list[ChainState]]:
    """A chain with the built-in controller, and its states over one recorded serve."""
    recording = open_recording(serve_recording)
    try:
        chain = RallyChain(calibrated_cameras(recording), controller=BuiltInController())
        names = list(recording.cameras)
        streams = [windows_between(stream, 0, 600_000, 2000) for stream in recording.cameras.values()]
        states = [chain.step(dict(zip(names, row, strict=True))) for row in zip(*streams, strict=True)]
    finally:
        recording.close()
    return chain, states


def test_every_new_prediction_of_the_hitting_plane_is_answered_at_once(followed) -> None:
    _, states = followed
    fresh = [state for state in states if state.is_new and state.prediction.hit_plane is not None]
    assert len(fresh) > 10
    for state in fresh:
        hit = state.prediction.hit_plane
        assert state.command.stage == hit.stage
        assert state.command.target.t_s == hit.t_s
        np.testing.assert_array_equal(state.command.ball_m, hit.p_world_m)


def test_between_predictions_the_command_stands_and_before_the_first_there_is_none(followed) -> None:
    _, states = followed
    first = next(number for number, state in enumerate(states) if state.is_new)
    assert all(state.command is None for state in states[:first])
    pairs = zip(states[first:], states[first + 1 :], strict=False)
    kept = [(a, b) for a, b in pairs if not b.is_new and b.prediction is a.prediction]
    assert len(kept) > 20 and all(b.command is a.command for a, b in kept)


def test_a_forgotten_flight_takes_its_command_with_it(followed) -> None:
    chain, states = followed
    assert states[-1].prediction is None or states[-1].command is not None
    chain.forget_flight()
    quiet = Window(Events.empty(SENSOR_720), 600_000, 602_000)
    assert chain.step(dict.fromkeys(chain.rig.names, quiet)).command is None


def test_deciding_takes_its_time_and_is_counted(followed) -> None:
    _, states = followed
    fresh = [state.seconds.control for state in states if state.is_new]
    idle = [state.seconds.control for state in states if not state.is_new]
    assert 0 < np.median(idle) < np.median(fresh) < 0.005
    for state in states[:3]:
        seconds = state.seconds
        assert seconds.total == pytest.approx(seconds.detect + seconds.triangulate + seconds.predict + seconds.control)
