from pathlib import Path

import numpy as np
import pytest

from core.cameras.presets import SENSOR_720
from core.chain import RallyChain
from core.chain.control.controller import BuiltInController
from core.chain.control.player import FREEZE_S, Player, PlayerState
from core.chain.follow import calibrated_cameras
from core.detection.window import windows_between
from core.events import Events, Window
from core.recordings import open_recording

pytestmark = pytest.mark.numeric


@pytest.fixture(scope="module")
def followed(serve_recording: Path) -> tuple[Player, list[PlayerState]]:
    """A player with the built-in controller, and its states over one recorded serve."""
    recording = open_recording(serve_recording)
    try:
        player = Player(RallyChain(calibrated_cameras(recording)), BuiltInController())
        names = list(recording.cameras)
        streams = [windows_between(stream, 0, 600_000, 2000) for stream in recording.cameras.values()]
        states = [player.step(dict(zip(names, row, strict=True))) for row in zip(*streams, strict=True)]
    finally:
        recording.close()
    return player, states


def test_every_new_prediction_of_the_hitting_plane_is_answered_at_once(followed) -> None:
    _, states = followed
    fresh = [state for state in states if state.is_new]
    assert len(fresh) > 10
    for state in fresh:
        hit = state.chain.prediction.hit_plane
        assert state.chain.is_new
        assert state.decision.stage == hit.stage
        assert state.decision.target.t_s == hit.t_s
        np.testing.assert_array_equal(state.decision.state[:3], hit.p_world_m)


def test_the_controller_is_told_the_spin_that_was_estimated(followed) -> None:
    _, states = followed
    last = [state for state in states if state.is_new][-1]
    hit = last.chain.prediction.hit_plane
    p, v = hit.p_world_m, hit.v_world_mps
    told, untold = (
        BuiltInController().decide(hit.t_s, p, v, stage="post", spin_radps=spin) for spin in (hit.spin_radps, None)
    )
    assert told is not None and untold is not None
    np.testing.assert_array_equal(last.decision.action, told.action)
    assert not np.array_equal(told.action, untold.action)


def test_between_predictions_the_command_stands_and_before_the_first_there_is_none(followed) -> None:
    _, states = followed
    first = next(number for number, state in enumerate(states) if state.is_new)
    assert all(state.decision is None for state in states[:first])
    pairs = zip(states[first:], states[first + 1 :], strict=False)
    kept = [(a, b) for a, b in pairs if not b.is_new and b.chain.prediction is not None]
    assert len(kept) > 20 and all(b.decision is a.decision for a, b in kept)


def test_a_forgotten_flight_takes_its_command_with_it(followed) -> None:
    player, states = followed
    assert any(state.decision is not None for state in states)
    player.forget_flight()
    quiet = Window(Events.empty(SENSOR_720), 600_000, 602_000)
    assert player.step(dict.fromkeys(player.chain.rig.names, quiet)).decision is None


def test_the_time_of_deciding_is_counted_in_every_step(followed) -> None:
    _, states = followed
    assert all(state.control_s > 0 for state in states) and any(state.is_new for state in states)


def test_just_before_the_impact_and_after_it_nothing_is_decided(followed) -> None:
    _, states = followed
    decided = [state for state in states if state.is_new]
    assert all(state.decision.target.t_s - state.chain.t_us * 1e-6 >= FREEZE_S for state in decided)
    impact_s = decided[-1].decision.target.t_s
    predicted = [state for state in states if state.chain.is_new and state.chain.prediction.hit_plane is not None]
    late = [state for state in predicted if impact_s - state.chain.t_us * 1e-6 < FREEZE_S]
    assert late and not any(state.is_new for state in late)
