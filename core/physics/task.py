"""The one-step task: where the ball is hit, how the racket stands and moves, and which serves arrive.

All of it is open in the paper and settled here by choice, tried out so that 3 to 9 m/s are reachable with 15 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import numpy as np

from core.config import check_settings, setting
from core.physics.config import PhysicsConfig, Profile, physics_profile
from core.physics.constants_file import FittedConstants

STAGE_SPEEDS_MPS: Final = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
"""Serve speeds that the tables below list; between them they are interpolated."""
HitRule = Literal["chosen", "paper"]
HIT_RULES: Final[tuple[HitRule, ...]] = get_args(HitRule)
"""`chosen`: the ball is met along its flight, where it can be met. `paper`: always at the published hitting plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElevationConfig:
    """Angle of the launch above the horizontal, by serve speed (choice)."""

    at_3_deg: float = setting(25.0, -20.0, 60.0)
    at_4_deg: float = setting(18.0, -20.0, 60.0)
    at_5_deg: float = setting(12.0, -20.0, 60.0)
    at_6_deg: float = setting(7.0, -20.0, 60.0)
    at_7_deg: float = setting(3.0, -20.0, 60.0)
    at_8_deg: float = setting(1.0, -20.0, 60.0)
    at_9_deg: float = setting(0.0, -20.0, 60.0)

    def __post_init__(self) -> None:
        check_settings(self)

    def at(self, speed_mps: float) -> float:
        """Radians at a serve speed."""
        table = [
            self.at_3_deg,
            self.at_4_deg,
            self.at_5_deg,
            self.at_6_deg,
            self.at_7_deg,
            self.at_8_deg,
            self.at_9_deg,
        ]
        return math.radians(float(np.interp(speed_mps, STAGE_SPEEDS_MPS, table)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RacketSpeedConfig:
    """Speed of the racket along +x at the impact, by serve speed (choice): it is negative for fast balls."""

    at_3_mps: float = setting(3.0, -5.0, 8.0)
    at_4_mps: float = setting(1.8, -5.0, 8.0)
    at_5_mps: float = setting(1.0, -5.0, 8.0)
    at_6_mps: float = setting(0.5, -5.0, 8.0)
    at_7_mps: float = setting(0.1, -5.0, 8.0)
    at_8_mps: float = setting(-0.5, -5.0, 8.0)
    at_9_mps: float = setting(-1.1, -5.0, 8.0)

    def __post_init__(self) -> None:
        check_settings(self)

    def at(self, speed_mps: float) -> float:
        """Metres per second at a serve speed."""
        table = [
            self.at_3_mps,
            self.at_4_mps,
            self.at_5_mps,
            self.at_6_mps,
            self.at_7_mps,
            self.at_8_mps,
            self.at_9_mps,
        ]
        return float(np.interp(speed_mps, STAGE_SPEEDS_MPS, table))


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeConfig:
    """The distribution that serves are drawn from. The defaults are the standard serve; `hard_serves` is the other."""

    elevation: ElevationConfig = field(default_factory=ElevationConfig)
    bounce_x_m: float = setting(-0.80, -1.3, -0.1)
    """Where a ball from the middle of the height range bounces on the average."""
    bounce_spread_m: float = setting(0.15, 0.0, 0.5)
    """Half the range of the uniform shift of the launch along x."""
    height_low_m: float = setting(0.28, 0.05, 1.5)
    """Lowest launch of the ball's centre above the table."""
    height_high_m: float = setting(0.42, 0.05, 1.5)
    """Highest launch."""
    lateral_spread_m: float = setting(0.35, 0.0, 0.7)
    """Half the range of y at the launch, and of the y that a serve with `aim_lateral` flies to."""
    aim_lateral: bool = False
    """Turn the serve towards a random y at the hitting plane; otherwise it flies straight along x."""
    elevation_spread_deg: float = setting(0.0, 0.0, 10.0)
    """Half the range of a uniform change of the elevation."""
    speed_spread: float = setting(0.0, 0.0, 0.3)
    """Half the range of a uniform relative change of the speed."""
    spin_spread_radps: float = setting(0.0, 0.0, 500.0)
    """Half the range of each spin component; 0 as in the paper."""
    only_legal: bool = True
    """Redraw serves that touch the net, miss the table or do not reach the hitting plane."""

    def __post_init__(self) -> None:
        check_settings(self)


def hard_serves() -> ServeConfig:
    """Serves that also vary in direction, elevation (2 degrees) and speed (5 %)."""
    return ServeConfig(aim_lateral=True, elevation_spread_deg=2.0, speed_spread=0.05)


@dataclass(frozen=True, slots=True, kw_only=True)
class StrokeConfig:
    """Where and how the racket meets the ball."""

    hit_plane_x_m: float = setting(-1.42, -2.0, -0.5)
    """The ball's centre is hit here (choice): 5 cm behind the table."""
    base_pitch_deg: float = setting(0.0, -45.0, 45.0)
    """Base orientation: how far the face's normal (+x at 0) is tilted up (choice). At 4 degrees a racket that does
    nothing already returns nearly every ball, so 0 keeps the task one that must be learned."""
    action_limit_deg: float = setting(15.0, 1.0, 45.0)
    """Each of the three angles at action 1 (paper)."""
    racket_speed: RacketSpeedConfig = field(default_factory=RacketSpeedConfig)

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskConfig:
    """Physics, serves and stroke of the one-step task."""

    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    serve: ServeConfig = field(default_factory=ServeConfig)
    stroke: StrokeConfig = field(default_factory=StrokeConfig)

    def __post_init__(self) -> None:
        check_settings(self)


def task_profile(profile: Profile, constants: FittedConstants | None = None) -> TaskConfig:
    """The task with the physics called `paper` or `real`; the latter with fitted constants of air and table, if given.

    Drag and the table's friction take about half of a real ball's speed on its way, so the racket must be faster. With
    these speeds random actions return a third of the balls or more, as with those of `paper`; 19 % at 4 m/s and 8 % at
    3 m/s, where many balls come low and steeply down.
    """
    if profile == "paper" and constants is None:
        return TaskConfig()
    speeds = RacketSpeedConfig(
        at_3_mps=3.8, at_4_mps=3.0, at_5_mps=2.4, at_6_mps=1.8, at_7_mps=1.3, at_8_mps=1.0, at_9_mps=0.7
    )
    physics = physics_profile(profile) if constants is None else constants.physics()
    return TaskConfig(physics=physics, stroke=StrokeConfig(racket_speed=speeds))
