"""Soft MuJoCo contacts: the restitution and friction that was asked for, on the average over the phase of the step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics import Case, strokes_from_actions
from core.physics.impact import strike, surfaces_from_config
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves, simulate_episodes
from core.simulation.episodes.mujoco_model import damping_ratio
from core.simulation.episodes.mujoco_soft import SoftTable, drop_on, simulate_episodes_soft

PAPER = task_profile("paper")


@pytest.mark.parametrize("surface", ["table", "racket"])
def test_oblique_drops_keep_the_wanted_restitution_and_the_rigid_tangential_impulse(surface: str) -> None:
    which = "table" if surface == "table" else "racket"
    rigid = surfaces_from_config(PAPER.physics)[0 if surface == "table" else 1]
    soft = SoftTable(PAPER)
    rng = np.random.default_rng(0)
    kept, impulse_ratio = [], []
    for _ in range(100):
        angle, around = np.radians(rng.uniform(20, 70)), rng.uniform(0, 2 * math.pi)
        tangent = math.sin(angle) * np.array([0, math.cos(around), math.sin(around)])
        velocity = rng.uniform(2, 8) * (np.array([-math.cos(angle), 0, 0]) + tangent)
        after = drop_on(soft, which, velocity, rng.uniform(0.001, 0.010))
        expected = np.concatenate([np.zeros(3), velocity, np.zeros(3)])
        strike(expected, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), rigid)
        kept.append(-after[0] / velocity[0])
        impulse_ratio.append(np.linalg.norm(after[1:3] - velocity[1:3]) / np.linalg.norm(expected[4:6] - velocity[1:3]))
    assert np.mean(kept) == pytest.approx(rigid.restitution, abs=0.01)
    assert np.mean(impulse_ratio) == pytest.approx(1.0, abs=0.05)


def test_soft_episodes_resemble_rigid_ones() -> None:
    rng = np.random.default_rng(1)
    serves = draw_serves(5.0, 30, PAPER, rng)
    strokes = strokes_from_actions(rng.uniform(-1, 1, (30, 3)), 1.0, PAPER.stroke)
    soft, rigid = simulate_episodes_soft(serves, strokes, PAPER), simulate_episodes(serves, strokes, PAPER)
    assert (soft.case != Case.MISSED).all()
    assert (soft.case == rigid.case).mean() > 0.7
    assert np.median(np.linalg.norm(soft.landings_m - rigid.landings_m, axis=1)) < 0.15


@pytest.mark.parametrize("restitution", [0.3, 0.78, 0.9, 0.99])
def test_the_damping_ratio_solves_the_released_spring(restitution: float) -> None:
    z = damping_ratio(restitution)
    root = math.sqrt(1 - z * z)
    assert math.exp(-2 * z / root * math.atan(root / z)) == pytest.approx(restitution)


def test_what_soft_contacts_cannot_do_is_refused() -> None:
    with pytest.raises(ConfigError, match="paper profile"):
        SoftTable(task_profile("real"))
    with pytest.raises(ConfigError, match="short step"):
        SoftTable(PAPER, dt_s=0.01)
