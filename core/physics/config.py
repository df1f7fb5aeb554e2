"""How the ball flies and bounces: every constant of the simulated physics, and the two named profiles.

`paper` is what the paper's simulator has: gravity, a spinless serve, rigid impacts. `real` adds drag, the Magnus force
and the measured behaviour of table and rubber. The paper gives no impact constants; those of `paper` are our choice.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from core.config import check_settings, setting
from core.errors import ConfigError
from core.table import AIR_KG_PER_M3, REAL_DRAG, REAL_FRICTION, REAL_MAGNUS, REAL_RESTITUTION

Profile = Literal["paper", "real"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AirConfig:
    """Forces of the air: drag -1/2 Cd rho A |v| v and Magnus C_M rho V (spin x v); both zero in `paper`."""

    drag_coefficient: float = setting(0.0, 0.0, 1.0)
    """C_d on the cross-section. `real` .554 +- .008: fitted to recorded flights of 3 to 12 m/s, see `core.table`. A
    smooth sphere has .47; our fit to 1,980 other flights has .51 at 3 m/s and .45 at 14 m/s."""
    magnus_coefficient: float = setting(0.0, 0.0, 0.5)
    """C_M on the ball's volume; the lift coefficient is 8/3 C_M (r spin / speed). `real` 0.10: our fit to 1,980 flights
    of known spin; it falls from .22 at low to .09 at high spin, so a constant is a compromise."""
    density_kg_per_m3: float = setting(AIR_KG_PER_M3, 0.5, 1.5)
    """Dry air at 20 degrees Celsius and sea level."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableImpactConfig:
    """The ball against the table: a point contact with restitution and Coulomb friction, so spin bends the bounce."""

    restitution: float = setting(0.90, 0.5, 1.0)
    """Normal speed kept at a slow bounce. `paper` .90 is a choice; `real` .945 +- .009: fitted to recorded flights, see
    `core.table`. The ITTF's 30 cm drop that returns about 23 cm gives .88, other recorded play .93 to .96."""
    restitution_loss_s_per_m: float = setting(0.0, 0.0, 0.05)
    """Decrease of the restitution per m/s of normal speed."""
    friction: float = setting(0.15, 0.0, 1.0)
    """Coulomb coefficient. `paper` 0.15 is a choice: with 0.25 a spinless 3 m/s serve loses so much speed that it falls
    below the table's edge before the hitting plane. `real` .227 +- .010: fitted, see `core.table`; the literature
    has .25."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class RubberImpactConfig:
    """The ball against the racket's rubber."""

    restitution: float = setting(0.78, 0.3, 1.0)
    """Normal speed kept at a slow impact. `paper` 0.78 is a choice; `real` .878 for inverted rubber."""
    restitution_loss_s_per_m: float = setting(0.0, 0.0, 0.05)
    """How much the restitution falls per m/s of normal speed. `real` .020."""
    tangential_restitution: float = setting(0.0, 0.0, 0.95)
    """Share of the contact point's tangential velocity that is reversed: 0 sticks (`paper`, a choice), 1 would be a
    perfect super ball. `real` .819 for inverted rubber."""
    tangential_loss_s_per_m: float = setting(0.0, 0.0, 0.05)
    """Decrease of the tangential restitution per m/s of tangential speed. `real` .010."""
    friction: float = setting(0.80, 0.0, 2.0)
    """Coulomb coefficient: the limit of the tangential impulse."""
    spin_retention: float = setting(1.0, 0.0, 1.0)
    """Share of the spin about the normal that survives. `real` .805."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicsConfig:
    """All constants of flight and impacts. The defaults are the profile `paper`; see `physics_profile`."""

    air: AirConfig = field(default_factory=AirConfig)
    table: TableImpactConfig = field(default_factory=TableImpactConfig)
    rubber: RubberImpactConfig = field(default_factory=RubberImpactConfig)
    racket_radius_m: float = setting(0.08, 0.02, 0.5)
    """The face is a disc; a ball whose centre passes it farther out misses (choice; a blade is 15 to 16 cm wide)."""
    racket_thickness_m: float = setting(0.10, 0.01, 0.3)
    """Thickness of the solid body behind the face: large, so that a soft contact does not come out at the back."""
    net_restitution: float = setting(0.10, 0.0, 1.0)
    """Speed kept across the net by a ball that touches it (choice; after the outcome is decided)."""
    net_drag: float = setting(0.5, 0.0, 1.0)
    """Share of the speed along the net that a touch takes (choice; after the outcome is decided)."""
    flight_step_s: float = setting(0.004, 0.0005, 0.02)
    """Step of the Runge-Kutta integration when the air acts; gravity alone is solved in closed form."""

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def has_air(self) -> bool:
        """Whether drag or Magnus force act."""
        return self.air.drag_coefficient > 0 or self.air.magnus_coefficient > 0


def physics_profile(profile: Profile) -> PhysicsConfig:
    """The constants called `paper` or `real`.

    Raises:
        ConfigError: if there is no such profile.
    """
    if profile == "paper":
        return PhysicsConfig()
    if profile == "real":
        return PhysicsConfig(
            air=AirConfig(drag_coefficient=REAL_DRAG.value, magnus_coefficient=REAL_MAGNUS),
            table=TableImpactConfig(restitution=REAL_RESTITUTION.value, friction=REAL_FRICTION.value),
            # An inverted rubber as a public simulator of robots has it; others have a restitution of 0.75 to 0.90.
            rubber=RubberImpactConfig(
                restitution=0.878,
                restitution_loss_s_per_m=0.020,
                tangential_restitution=0.819,
                tangential_loss_s_per_m=0.010,
                spin_retention=0.805,
            ),
        )
    raise ConfigError("no such physics profile", expected="paper | real", got=repr(profile))
