"""Exact constants of the simulation are handed to nobody who did not ask for them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.rally.closed_loop import ClosedLoop
from core.cameras import stereo_preset
from core.chain.control.controller import BuiltInController
from core.learning.config import EnvironmentConfig
from core.live.worlds.event_environment import EventCameraBackend, EventEnvironmentConfig
from core.live.worlds.world import WorldConfig
from core.physics.config import PhysicsConfig, physics_profile
from core.physics.task import TaskConfig
from core.trajectory import FilterConfig, FilterPredictor

pytestmark = pytest.mark.numeric
PAPER, REAL = physics_profile("paper"), replace(physics_profile("real"), rubber=physics_profile("paper").rubber)
"""The same racket: that is one's own."""


def closed_loop(physics: PhysicsConfig, *, knows_physics: bool) -> ClosedLoop:
    loop = ClosedLoop(
        WorldConfig(task=TaskConfig(physics=physics)), stereo_preset(), seed=1, knows_physics=knows_physics
    )
    loop.close()
    return loop


def backend(physics: PhysicsConfig, *, knows_physics: bool) -> EventCameraBackend:
    environment = EnvironmentConfig(task=TaskConfig(physics=physics), state_source="events")
    made = EventCameraBackend(environment, config=EventEnvironmentConfig(knows_physics=knows_physics))
    made.close()
    return made


def filters_of(config: FilterConfig) -> list[FilterConfig]:
    """What is expected of the first ball."""
    return [kind for kind, _ in FilterPredictor(config).learned.kinds(config)]


@pytest.mark.gate
def test_chain_and_controller_are_the_same_in_whatever_world_they_play() -> None:
    one, other = (closed_loop(physics, knows_physics=False) for physics in (PAPER, REAL))
    assert one.player.chain.config == other.player.chain.config
    controllers = [loop.player.controller for loop in (one, other)]
    assert all(isinstance(controller, BuiltInController) for controller in controllers)
    assert controllers[0].task.physics == controllers[1].task.physics
    knowing = [closed_loop(physics, knows_physics=True) for physics in (PAPER, REAL)]
    assert knowing[0].player.chain.config != knowing[1].player.chain.config, "the comparison can tell"
    assert knowing[0].player.controller.task.physics != knowing[1].player.controller.task.physics


def test_the_state_of_the_training_from_events_is_the_same_in_whatever_world() -> None:
    one, other = (backend(physics, knows_physics=False)._chain.config for physics in (PAPER, REAL))
    assert one == other
    assert backend(REAL, knows_physics=True)._chain.config != one


@pytest.mark.parametrize("physics", [PAPER, REAL])
def test_no_constant_of_the_world_is_expected_to_be_exactly_so(physics: PhysicsConfig) -> None:
    config = closed_loop(physics, knows_physics=False).player.chain.config.filter
    table, air = physics.table, physics.air
    for kind in filters_of(config):
        assert kind.restitution != table.restitution and kind.restitution_sigma > 0.02
        assert kind.friction != table.friction and kind.friction_sigma > 0.03
        if kind.magnus:
            assert kind.drag != air.drag_coefficient and kind.drag_sigma > 0.03
    expected = closed_loop(physics, knows_physics=False).player.controller.task.physics
    assert expected.air.drag_coefficient != air.drag_coefficient
    assert expected.table.restitution != table.restitution and expected.table.friction != table.friction


def test_a_first_ball_shows_before_its_bounce_that_there_is_no_air() -> None:
    loop = ClosedLoop(WorldConfig(), stereo_preset(), seed=91001, hit="chosen", point_sigma_m=0.0008)
    try:
        ball = loop.play(5.0)
        goal_m = loop.player.controller.goal_m
    finally:
        loop.close()
    off_m = np.linalg.norm(ball.judged.outcome.landing_m[:2] - goal_m)
    assert ball.returned and off_m < 0.1, "with air it would land 0.27 m long"


def test_what_the_chain_learns_reaches_the_controller_and_a_reset_takes_it_away() -> None:
    loop = ClosedLoop(WorldConfig(), stereo_preset(), seed=5)
    try:
        ball = loop.play(5.0)
        learned, informed = loop.player.chain.learned, loop.player._informed_controller()
    finally:
        loop.close()
    assert ball.returned
    assert learned is not None and learned.balls == 1 and learned.air < 0.5
    assert abs(learned.means[1] - 0.90) < 0.015
    assert isinstance(informed, BuiltInController)
    assert informed.task.physics.air.drag_coefficient == 0.0, "the world is the paper's: it has no air"
    assert informed.task.physics.rubber == PAPER.rubber
    loop.player.reset()
    forgotten = loop.player.chain.learned
    assert forgotten is not None and forgotten.balls == 0
    assert loop.player._informed_controller() is loop.player.controller
