"""What a chain is told of the physics that its ball flies by."""

from __future__ import annotations

from dataclasses import replace

from core.physics.config import PhysicsConfig
from core.rally.chain.config import ChainConfig
from core.trajectory.filter_config import with_physics


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
