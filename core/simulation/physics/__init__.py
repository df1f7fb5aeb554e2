"""Table-tennis physics: serves, flight, impacts and the outcome of a stroke, in numba; and the same in MuJoCo.

The names below never load mujoco; `mujoco_rally` and `mujoco_soft` do when they are imported.
"""

from core.simulation.physics.config import PhysicsConfig, physics_profile
from core.simulation.physics.episode import Case, Outcomes, Serves, Strokes, strokes_from_actions
from core.simulation.physics.serve import draw_serves
from core.simulation.physics.simulate import fly_serves, return_balls, simulate_episodes
from core.simulation.physics.task import TaskConfig

__all__ = [
    "Case",
    "Outcomes",
    "PhysicsConfig",
    "Serves",
    "Strokes",
    "TaskConfig",
    "draw_serves",
    "fly_serves",
    "physics_profile",
    "return_balls",
    "simulate_episodes",
    "strokes_from_actions",
]
