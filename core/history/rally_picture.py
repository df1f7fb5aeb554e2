"""Content of the 3D scene at one moment, as a frozen value, for live rallies, recordings and training."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.physics.episode import Case

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose of a racket: its centre, and the rotation from its frame (normal along +x) to the world."""

    p_world_m: Array
    wxyz: Array


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyEllipse:
    """Uncertainty ellipse of a point in a plane."""

    centre: Array
    """(3,)"""
    axes: Array
    """(2, 3) half axes, one standard deviation long."""


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """Simulated persons at one time, as rounded rods and blades."""

    parts: Array
    """(P, PART_COLUMNS), see `core.simulation.bodies.parts`."""
    ends_m: Array
    """(P, 2, 3) their ends."""


@dataclass(frozen=True, slots=True)
class LandingSpot:
    """Landing point of a past ball."""

    x_m: float
    y_m: float
    case: Case


@dataclass(frozen=True, slots=True, eq=False)
class RallyPicture:
    """World frame, metres. None or empty is not drawn."""

    ball: Array | None = None
    """(3,) measured position."""
    trail: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3), oldest first."""
    trail_speeds_mps: Array = field(default_factory=lambda: np.empty(0))
    """(N,) how fast it was there."""
    truth: Array | None = None
    rays: tuple[tuple[Array, Array], ...] = ()
    """From each camera to the ball that it sees."""
    before_bounce: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3) the flight as predicted before the bounce, up to the hitting plane."""
    after_bounce: Array = field(default_factory=lambda: np.empty((0, 3)))
    tube: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3) the newest prediction's path."""
    tube_sigmas: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3) its standard deviations."""
    spreads: tuple[UncertaintyEllipse, ...] = ()
    """Uncertainty of the expected bounce and of the hit."""
    bounce: Array | None = None
    """Predicted or past bounce."""
    bounce_in_s: float | None = None
    """Until it bounces there; None if it is not expected to any more."""
    hit: Array | None = None
    """Predicted position where the ball is to be hit: as chosen, or at the hitting plane."""
    hit_places: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3) where else along the flight a stroke could return the ball."""
    refused_places: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(M, 3) where none can."""
    no_stroke: str = ""
    """Why no stroke can return the ball, in words; empty if one can, or nobody knows."""
    hit_in_s: float | None = None
    people: People | None = None
    racket: Pose | None = None
    racket_target: Pose | None = None
    landing_target: Array | None = None
    """(2,) on the table."""
    spots: tuple[LandingSpot, ...] = ()
    """Landing points of past balls, oldest first."""
