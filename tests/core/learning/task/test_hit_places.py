"""Balls of a task are met where each can best be met; the action stays the orientation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.chain.control.hit_choice import PAPER_X_M, HitChoiceConfig
from core.learning.config import EnvironmentConfig, StateSource
from core.learning.randomisation import RandomisationConfig
from core.learning.task.drawn_worlds import with_constants
from core.learning.task.environment import ServeBatch, draw_serve_batch, play
from core.physics.episode import Case
from core.physics.task import task_profile
from core.simulation.episodes.closed_form import fly_serves

pytestmark = pytest.mark.numeric
SLOW = EnvironmentConfig(task=task_profile("real"), state_source="truth", hit="chosen")
"""With air, serves of 3 m/s come to the plane low and steeply down."""
FACE_UP = np.array([0.0, -4 / 15, 0.0])


def drawn(environment: EnvironmentConfig, speed_mps: float = 3.0, count: int = 12) -> ServeBatch:
    return draw_serve_batch(speed_mps, count, environment, np.random.default_rng(4))


def test_slow_balls_are_met_at_places_of_the_choice_where_they_are_higher() -> None:
    chosen, at_plane = drawn(SLOW), drawn(dataclasses.replace(SLOW, hit="paper"))
    np.testing.assert_array_equal(chosen.serves.states(), at_plane.serves.states())
    xs = chosen.states[:, 0]
    assert (np.abs(xs[:, None] - HitChoiceConfig().xs_m).min(axis=1) < 1e-9).all()
    elsewhere = np.abs(xs - PAPER_X_M) > 1e-6
    assert elsewhere.any()
    assert (chosen.arrivals.t_s[xs > PAPER_X_M + 1e-6] < at_plane.arrivals.t_s[xs > PAPER_X_M + 1e-6]).all()
    np.testing.assert_array_equal(chosen.states, chosen.arrivals.states[:, :6])
    np.testing.assert_array_equal(chosen.states[~elsewhere], at_plane.states[~elsewhere])


def test_nothing_changes_where_balls_are_met_at_the_plane() -> None:
    assert EnvironmentConfig().hit == "paper"
    batch = drawn(dataclasses.replace(SLOW, hit="paper"))
    np.testing.assert_allclose(batch.states[:, 0], PAPER_X_M)


@pytest.mark.parametrize("source", ["truth", "truth+noise", "predicted", "timed"])
def test_every_source_of_the_state_tells_of_the_ball_at_its_place(source: StateSource) -> None:
    batch = drawn(dataclasses.replace(SLOW, state_source=source), count=6)
    assert batch.seen.sum() >= 5
    seen, arrived = batch.states[batch.seen], batch.arrivals.states[batch.seen]
    np.testing.assert_allclose(seen[:, 0], arrived[:, 0], atol=5e-3)
    off_m = 0.12 if source == "predicted" else 0.05  # the paper's fit knows no drag
    np.testing.assert_allclose(seen[:, :3], arrived[:, :3], atol=off_m)
    if batch.aim_ps_m is not None:
        np.testing.assert_allclose(batch.aim_ps_m[batch.seen], arrived[:, :3], atol=off_m)


def test_mujoco_plays_the_strokes_where_the_closed_form_does() -> None:
    batch = drawn(SLOW, count=6)
    actions = np.tile(FACE_UP, (6, 1))
    closed, stepped = (play(batch, actions, dataclasses.replace(SLOW, engine=one)) for one in ("closed-form", "mujoco"))
    assert (closed.case != Case.MISSED).all()
    np.testing.assert_array_equal(closed.case, stepped.case)
    np.testing.assert_allclose(closed.hit_states[:, 0], batch.states[:, 0], atol=1e-6)
    np.testing.assert_allclose(stepped.landings_m, closed.landings_m, atol=2e-3)


def test_a_ball_of_another_world_is_met_where_it_flies_there() -> None:
    differs = dataclasses.replace(SLOW, randomise=RandomisationConfig(physics=True, rubber=True))
    batch, at_plane = drawn(differs, count=6), drawn(dataclasses.replace(differs, hit="paper"), count=6)
    assert batch.constants is not None
    np.testing.assert_array_equal(batch.constants, at_plane.constants)
    assert (np.abs(batch.states[:, 0] - PAPER_X_M) > 1e-6).any()
    for i in range(6):
        own = with_constants(differs.task, batch.constants[i])
        there = dataclasses.replace(own, stroke=dataclasses.replace(own.stroke, hit_plane_x_m=batch.states[i, 0]))
        np.testing.assert_allclose(fly_serves(batch.serves[i : i + 1], there).states[0, :6], batch.states[i], atol=1e-9)
    assert np.isin(play(batch, np.tile(FACE_UP, (6, 1)), differs).case, (Case.MISSED,)).sum() == 0


def test_a_wrong_calibration_shifts_the_state_within_the_plane_where_the_ball_is_met() -> None:
    exact, seen = drawn(SLOW), drawn(dataclasses.replace(SLOW, randomise=RandomisationConfig(calibration=True)))
    np.testing.assert_allclose(seen.states[:, 0], exact.states[:, 0], atol=1e-9)
    assert (np.abs(exact.states[:, 0] - PAPER_X_M) > 1e-6).any()
    assert 1e-3 < np.abs(seen.states[:, 1:3] - exact.states[:, 1:3]).max() < 0.05
    assert seen.aim_ps_m is not None and seen.aim_t_s is not None
    np.testing.assert_allclose(seen.aim_ps_m, seen.states[:, :3])
    assert 1e-4 < np.abs(seen.aim_t_s - exact.arrivals.t_s).max() < 0.01
