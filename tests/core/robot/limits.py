"""What the robots of the tests keep to: a box round their own edge of the table."""

from core.robot import RobotLimits

LIMITS = RobotLimits(
    low_m=(-2.2, -1.0, 0.02),
    high_m=(-1.0, 1.0, 0.9),
    max_speed_mps=5.0,
    max_acceleration_mps2=80.0,
    max_turn_rate_radps=20.0,
)
