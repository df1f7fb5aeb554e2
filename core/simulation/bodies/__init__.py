"""Things that move besides the ball and the robot's racket: persons, their rackets, a head."""

from core.simulation.bodies.actors import make_actors
from core.simulation.bodies.parts import MovingBodies, hidden_by_bodies

__all__ = ["MovingBodies", "hidden_by_bodies", "make_actors"]
