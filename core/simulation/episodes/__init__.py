"""Episodes of the one-step task: serves, strokes and outcomes in closed form (numba), and the same in MuJoCo.

The names below never load mujoco; `mujoco_rally` and `mujoco_soft` do when they are imported.
"""

from core.simulation.episodes.closed_form import fly_serves, return_balls, simulate_episodes
from core.simulation.episodes.serve import draw_serves

__all__ = ["draw_serves", "fly_serves", "return_balls", "simulate_episodes"]
