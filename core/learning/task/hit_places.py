"""Where the balls of a task are met: not at its plane, but where each can best be met along its flight."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import ChainState
from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import FaceTrajectory, HitChoiceConfig, RacketReach, choose_hit
from core.chain.control.hit_selector import COMMAND_S, HitSelector
from core.chain.control.known_flight import KnownFlight, fly_to_planes
from core.learning.config import EnvironmentConfig
from core.learning.task.drawn_worlds import equal_rows, join_rows, select_arrivals, with_constants
from core.physics.episode import Arrivals, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.racket import RacketConfig
from core.trajectory.prediction import HitPlane

Array = NDArray[np.float64]

UNSEEN: Final = np.diag([1.0, 1.0, 1.0, 10.0, 10.0, 10.0]) ** 2
"""Covariance (m, m/s) of a ball that nobody has seen: what counts is how well it will be known after it was watched."""


def choosing_controller(environment: EnvironmentConfig) -> BuiltInController:
    """Who says how a ball could be hit at several places: the built-in controller, towards the middle of the targets.

    The place then follows from the flight alone, which is all that a policy is told of it.
    """
    return BuiltInController(environment.task).aimed_at(environment.goal.centre_m)


def arrivals_where_chosen(
    serves: Serves, at_plane: Arrivals, environment: EnvironmentConfig, constants: Array | None = None
) -> Arrivals:
    """The balls where each can best be met; at the plane of the task where no stroke returns it.

    A place is chosen as in the live rally, by a racket at rest at home, with the ball known as well as it will be then.
    Each ball flies in its own world, but strokes are judged in the task's: nobody knows another one.

    Args:
        serves: N launches.
        at_plane: of the same balls at the hitting plane.
        environment: the task.
        constants: (N, 5) of each ball's world, `drawn_worlds.CONSTANTS`; None: those of the task.
    """
    controller, task = choosing_controller(environment), environment.task
    if constants is None or not len(constants):
        return _chosen_in(task, serves, at_plane, controller)
    worlds = [(rows, with_constants(task, constants[rows.start])) for rows in equal_rows(constants)]
    return join_rows(
        [_chosen_in(own, serves[rows], select_arrivals(at_plane, rows), controller) for rows, own in worlds]
    )


def _chosen_in(task: TaskConfig, serves: Serves, at_plane: Arrivals, controller: BuiltInController) -> Arrivals:
    """Balls that fly in one world."""
    racket, choice = RacketConfig(), HitChoiceConfig()
    rest, reach = FaceTrajectory(COMMAND_S, racket.home_m, np.zeros(3)), RacketReach.of_config(racket)
    planes = fly_to_planes(serves, choice.xs_m, task)
    t_s, states = at_plane.t_s.copy(), at_plane.states.copy()
    for i in np.flatnonzero(at_plane.legal):
        flight = KnownFlight.of(planes, int(i), covariance=UNSEEN)
        chosen = choose_hit(flight, controller.strokes(), rest, reach, choice).chosen
        if chosen is not None and chosen.hit.spin_radps is not None:
            hit = chosen.hit
            t_s[i], states[i] = hit.t_s, np.concatenate([hit.p_world_m, hit.v_world_mps, chosen.hit.spin_radps])
    return dataclasses.replace(at_plane, t_s=t_s, states=states)


class HitPlaces:
    """Where balls that a chain follows are met: at the plane of the task, or as chosen by what is predicted of each."""

    def __init__(self, environment: EnvironmentConfig) -> None:
        self._selector, self._controller = None, None
        if environment.hit == "chosen":
            self._selector, self._controller = HitSelector(), choosing_controller(environment)
        racket = RacketConfig()
        self._home_m: Array = racket.home_m
        self._reach = RacketReach.of_config(racket)

    def forget_flight(self) -> None:
        """Expect a new ball."""
        if self._selector is not None:
            self._selector.forget_flight()

    def of(self, state: ChainState) -> HitPlane | None:
        """The place after a step; None without a new prediction, or where the ball does not come."""
        prediction = state.prediction
        if not state.is_new or prediction is None:
            return None
        if self._selector is None or self._controller is None:
            return prediction.hit_plane
        rest = FaceTrajectory(state.t_us * 1e-6 + COMMAND_S, self._home_m, np.zeros(3))
        return self._selector.place(prediction, self._controller.strokes(), lambda: rest, self._reach, state.bounces_us)
