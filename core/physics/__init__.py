"""Physics of the ball: constants, flight, contacts and impacts, the values of an episode, recorded flights and fits."""

from core.physics.config import PhysicsConfig, physics_profile
from core.physics.episode import Case, Outcomes, Serves, Strokes, strokes_from_actions
from core.physics.task import TaskConfig

__all__ = [
    "Case",
    "Outcomes",
    "PhysicsConfig",
    "Serves",
    "Strokes",
    "TaskConfig",
    "physics_profile",
    "strokes_from_actions",
]
