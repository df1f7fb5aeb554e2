"""The MuJoCo model of table, net, posts, ball and a thick racket, written as XML.

With `soft` off there is no contact in it: impacts are impulses that the stepping code gives. With `soft` on, MuJoCo's
own contacts do it, with settings that were measured.
"""

from __future__ import annotations

import math
from typing import Any, Final

import mujoco

from core.physics.config import PhysicsConfig
from core.table import (
    BALL_MASS_KG,
    BALL_RADIUS_M,
    GRAVITY_MPS2,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

mj: Final[Any] = mujoco
"""The compiled module comes without type stubs: its names are untyped, here and in the files that step the model."""
BALL_INERTIA_KGM2 = 2 / 3 * BALL_MASS_KG * BALL_RADIUS_M**2
RACKET_MASS_KG = 50.0
"""So heavy that the ball does not slow it: 5e-5 of the momentum."""
CONTACT_STEPS = 8
"""Time steps that a soft contact lasts. Fewer lose friction (6: 0.90 to 0.96 of rigid Coulomb), and with a step of 1 ms
instead of 0.5 ms the ball sinks so deep that the shorter lever to the contact point adds friction (1.08)."""
_SPHERE_ADDED_MASS = 0.5
"""Added mass as a share of the displaced air. MuJoCo's ellipsoid fluid model subtracts this much from the Magnus
coefficient of a sphere."""


def damping_ratio(restitution: float) -> float:
    """The damping ratio of a spring contact, released where its force is zero, that keeps this share of the speed."""
    if restitution >= 1:
        return 0.0
    low, high = 0.0, 0.999
    for _ in range(80):
        z = (low + high) / 2
        root = math.sqrt(1 - z * z)
        kept = 1.0 if z == 0 else math.exp(-2 * z / root * math.atan(root / z))
        low, high = (z, high) if kept > restitution else (low, z)
    return (low + high) / 2


def build_model(physics: PhysicsConfig, *, dt_s: float, soft: bool = False) -> Any:
    """The compiled model: free bodies `ball` (qpos 0:7, qvel 0:6) and `racket` (qpos 7:14, qvel 6:12)."""
    return mj.MjModel.from_xml_string(model_xml(physics, dt_s=dt_s, soft=soft))


def model_xml(physics: PhysicsConfig, *, dt_s: float, soft: bool = False) -> str:
    """The model's XML; the world frame is the table's (origin in the middle of the top)."""
    half_l, half_w = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
    top = 0.1  # half the thickness of the table's body: soft contacts sink in by several millimetres
    post_y = half_w + NET_OVERHANG_M
    air = physics.air
    density = air.density_kg_per_m3 if physics.has_air else 0.0
    drag = air.drag_coefficient / 2  # MuJoCo's drag is C rho A v^2, without the usual half
    magnus = air.magnus_coefficient + _SPHERE_ADDED_MASS
    inertia = " ".join([str(BALL_INERTIA_KGM2)] * 3)
    deep = physics.racket_thickness_m / 2
    options = f'timestep="{dt_s}" gravity="0 0 {-GRAVITY_MPS2}" density="{density}" viscosity="0" '
    options += (
        'integrator="Euler" cone="elliptic" impratio="1e-6" noslip_iterations="5" iterations="30" tolerance="1e-10"'
        if soft
        else 'integrator="RK4"'
    )
    return f"""
<mujoco model="table tennis">
  <option {options}/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" pos="0 0 {-TABLE_HEIGHT_M}" size="6 4 0.1" rgba="0.2 0.2 0.22 1"/>
    <geom name="table" type="box" pos="0 0 {-top}" size="{half_l} {half_w} {top}" rgba="0.1 0.3 0.6 1"/>
    <geom name="net" type="box" pos="0 0 {NET_HEIGHT_M / 2}" size="0.002 {post_y} {NET_HEIGHT_M / 2}" rgba="1 1 1 0.5"/>
    <geom name="post_left" type="cylinder" pos="0 {post_y} {NET_HEIGHT_M / 2}" size="0.01 {NET_HEIGHT_M / 2}"/>
    <geom name="post_right" type="cylinder" pos="0 {-post_y} {NET_HEIGHT_M / 2}" size="0.01 {NET_HEIGHT_M / 2}"/>
    <body name="ball" pos="0 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="{BALL_MASS_KG}" diaginertia="{inertia}"/>
      <geom name="ball" type="sphere" size="{BALL_RADIUS_M}" rgba="1 0.6 0.1 1" fluidshape="ellipsoid"
            fluidcoef="{drag} {drag} 0 0 {magnus}"/>
    </body>
    <body name="racket" pos="-1.6 0 0.25" gravcomp="1">
      <freejoint/>
      <inertial pos="0 0 0" mass="{RACKET_MASS_KG}" diaginertia="50 50 50"/>
      <geom name="racket" type="cylinder" pos="{-deep} 0 0" zaxis="1 0 0" size="{physics.racket_radius_m} {deep}"
            rgba="0.8 0.1 0.1 1" fluidshape="ellipsoid" fluidcoef="0 0 0 0 0"/>
    </body>
  </worldbody>
  {_soft_pairs(physics, dt_s) if soft else ""}
</mujoco>"""


def _soft_pairs(physics: PhysicsConfig, dt_s: float) -> str:
    # All of it is needed (drops of 2 to 8 m/s, 20 to 70 degrees from the normal): a spring with a damping that releases
    # at zero force gives the restitution; a friction reference of its own, else friction is nearly off (0.43 of rigid
    # Coulomb); the tiny impratio with noslip iterations, else the elliptic cone eats bounce (.87 for .90).
    contact_time_s = CONTACT_STEPS * dt_s

    def pair(other: str, restitution: float, friction: float) -> str:
        k = (math.pi / contact_time_s) ** 2
        b = 2 * damping_ratio(restitution) * math.pi / contact_time_s
        return (
            f'<pair geom1="ball" geom2="{other}" condim="3" friction="{friction} {friction}" '
            f'solref="{-k} {-b}" solreffriction="-0.001 {-0.3 / dt_s}" solimp="0.99 0.99 0.001"/>'
        )

    dead = "".join(
        f'<pair geom1="ball" geom2="{name}" condim="1" solref="0.01 1"/>' for name in ("net", "post_left", "post_right")
    )
    table = pair("table", physics.table.restitution, physics.table.friction)
    rubber = pair("racket", physics.rubber.restitution, physics.rubber.friction)
    floor = '<pair geom1="ball" geom2="floor" condim="1" solref="0.01 1"/>'
    return f"<contact>{table}{rubber}{dead}{floor}</contact>"
