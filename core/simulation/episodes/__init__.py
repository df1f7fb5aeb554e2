"""Episodes of the one-step task: serves, strokes and outcomes in closed form (numba), and the same in MuJoCo.

The names below never load mujoco; `mujoco_rally` does when it is imported.
"""

from core.simulation.episodes.closed_form import draw_serves, fly_serves, return_balls, simulate_episodes

__all__ = ["draw_serves", "fly_serves", "return_balls", "simulate_episodes"]
