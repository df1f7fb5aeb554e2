"""What a chain and a controller assume of the ball's physics: nothing, unless it is given."""

from __future__ import annotations

from dataclasses import replace

from core.chain.config import ChainConfig
from core.physics.config import PhysicsConfig
from core.physics.constants_file import FittedConstants
from core.trajectory.ball_kernel import AIR_KG_PER_M3
from core.trajectory.filter_config import UNKNOWN, FilterConfig, with_fitted_constants, with_physics
from core.trajectory.learned_constants import LearnedConstants


def expected_physics(physics: PhysicsConfig) -> PhysicsConfig:
    """Air and table of which nobody said anything, as published of any; the racket is one's own, and is known."""
    return _with(physics, UNKNOWN["drag"], UNKNOWN["magnus"], UNKNOWN["restitution"], UNKNOWN["friction"])


def learned_physics(learned: LearnedConstants, physics: PhysicsConfig) -> PhysicsConfig:
    """Air and table as the balls so far have them; the racket of `physics`."""
    drag, restitution, friction = learned.means.tolist()
    there = learned.air > 0.5
    return _with(physics, drag if there else 0.0, UNKNOWN["magnus"] if there else 0.0, restitution, friction)


def _with(physics: PhysicsConfig, drag: float, magnus: float, restitution: float, friction: float) -> PhysicsConfig:
    air = replace(physics.air, drag_coefficient=drag, magnus_coefficient=magnus, density_kg_per_m3=AIR_KG_PER_M3)
    table = replace(physics.table, restitution=restitution, restitution_loss_s_per_m=0.0, friction=friction)
    return replace(physics, air=air, table=table)


def chain_for_physics(chain: ChainConfig, physics: PhysicsConfig) -> ChainConfig:
    """The chain with air and table of `physics`; its own settings where that is the paper's: they are made for it."""
    if physics == PhysicsConfig():
        return replace(chain, filter=replace(chain.filter, perhaps_real=False))
    air, table = physics.air, physics.table
    ball = replace(
        with_physics(chain.filter, "real" if physics.has_air else "paper"),
        drag=air.drag_coefficient,
        magnus=air.magnus_coefficient,
        restitution=table.restitution,
        friction=table.friction,
        perhaps_real=False,
    )
    fit = replace(chain.predictor, restitution=table.restitution, friction=table.friction)
    return replace(chain, predictor=fit, filter=ball)


def chain_with_constants(chain: ChainConfig, constants: FittedConstants) -> ChainConfig:
    """The chain whose filter begins with fitted constants; the paper's fit keeps those that were published with it."""
    return replace(chain, filter=fitted_filter(chain.filter, constants))


def fitted_filter(config: FilterConfig, constants: FittedConstants) -> FilterConfig:
    """The filter that begins with fitted constants, see `with_fitted_constants`."""
    drag, restitution, friction = constants.drag_coefficient, constants.restitution, constants.friction
    return with_fitted_constants(config, drag, restitution, friction, constants.magnus_coefficient)
