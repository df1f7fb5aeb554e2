"""Balls of the closed-form simulation, seen with the noise that the chain was measured to have: no cameras, no events.

A thousand times faster than the whole chain, for what needs many balls. What it cannot show is what events do near a
racket: points are simply left out there, for as long as the chain was measured to see nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, stereo_preset
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import draw_serve_batch, play, strokes_of
from core.outcomes.ball_log import BallPoints
from core.physics.episode import Case, Outcomes
from core.simulation.episodes.episode_path import Trajectory, trace_episode

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackNoise:
    """Noise of the chain with the detector `refined` and cameras of the `side` placement, measured on the outgoing
    flights of 59 balls, which no figure is made of. In millimetres along x, y, z.
    """

    bias_mm: tuple[float, float, float] = (0.15, 0.17, 0.19)
    """Root mean square over flights; the mean, which is not zero, counts as bias."""
    drift_mm: tuple[float, float, float] = (0.09, 0.21, 0.18)
    drift_s: float = 0.006
    noise_mm: tuple[float, float, float] = (0.07, 0.09, 0.06)
    said_mm: tuple[float, float, float] = (0.13, 0.36, 0.22)
    """What the points say of themselves."""
    period_s: float = 0.002
    hidden_s: float = 0.010
    """After the racket nothing is seen."""
    lost: float = 0.0
    """Share of points that are missing, by chance."""
    strays: float = 0.0
    """Share of points that are somewhere else, up to 10 cm off."""


@dataclass(frozen=True, slots=True, eq=False)
class NoisyBall:
    """One ball: what is seen of it, and what became of it."""

    points: BallPoints
    case: Case
    outcome: Outcomes
    path: Trajectory
    speed_mps: float

    @property
    def hit_s(self) -> float | None:
        """When it was struck, after the launch; None for a ball that was not."""
        return next((event.t_s for event in self.path.events if event.kind == "hit"), None)


def draw_ball(
    environment: EnvironmentConfig,
    rng: np.random.Generator,
    *,
    noise: TrackNoise | None = None,
    cameras: dict[str, Camera] | None = None,
    missed: float = 0.05,
    until_s: float = 4.0,
) -> NoisyBall:
    """A serve of 3 to 9 m/s, a stroke anywhere in the range of actions or (a share `missed`) none, and its points."""
    speed_mps = float(rng.uniform(3, 9))
    ball = draw_serve_batch(speed_mps, 1, environment, rng)
    action = rng.uniform(-1, 1, (1, 3))
    struck = rng.random() >= missed
    strokes = strokes_of(ball, action, environment) if struck else None
    path = trace_episode(ball.serves, strokes, environment.task, duration_s=until_s)
    outcome = play(ball, action, environment)
    case = Case(int(outcome.case[0])) if struck else Case.MISSED
    points = see_path(path, noise or TrackNoise(), stereo_preset() if cameras is None else cameras, rng)
    return NoisyBall(points, case, outcome, path, speed_mps)


def see_path(path: Trajectory, noise: TrackNoise, cameras: dict[str, Camera], rng: np.random.Generator) -> BallPoints:
    """The points of a path that all cameras have in their picture; times count from the launch."""
    t_s = np.arange(path.start_s + float(rng.uniform(0, noise.period_s)), path.end_s, noise.period_s)
    truth = path.at(t_s)[:, :3]
    seen = rng.random(len(t_s)) >= noise.lost
    for camera in cameras.values():
        uvs = camera.project(truth)
        inside = (uvs >= 5) & (uvs < np.array([camera.sensor.width_px, camera.sensor.height_px]) - 5)
        seen &= np.isfinite(uvs).all(axis=1) & inside.all(axis=1)
    for event in path.events:
        if event.kind == "hit":
            seen &= (t_s < event.t_s) | (t_s > event.t_s + noise.hidden_s)
    n = len(t_s)
    drift = rng.standard_normal((n, 3))
    kept = np.exp(-noise.period_s / noise.drift_s)
    for i in range(1, n):
        drift[i] = kept * drift[i - 1] + np.sqrt(1 - kept**2) * drift[i]
    errors_mm = np.array(noise.drift_mm) * drift + np.array(noise.noise_mm) * rng.standard_normal((n, 3))
    errors_mm += np.array(noise.bias_mm) * rng.standard_normal(3)
    strays = rng.random(n) < noise.strays
    errors_mm[strays] += rng.uniform(-100, 100, (int(strays.sum()), 3))
    covariance = np.diag((1e-3 * np.array(noise.said_mm)) ** 2)
    ps = (truth + 1e-3 * errors_mm)[seen]
    return BallPoints(0, t_s[seen], ps, np.tile(covariance, (len(ps), 1, 1)))
