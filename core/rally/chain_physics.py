"""What a chain is told of the physics that its ball flies by."""

from __future__ import annotations

from dataclasses import replace

from core.rally.config import ChainConfig
from core.simulation.physics.config import PhysicsConfig


def chain_for_physics(chain: ChainConfig, physics: PhysicsConfig) -> ChainConfig:
    """The chain with the table of `physics`; its own settings where that is the paper's, which they are made for."""
    if physics == PhysicsConfig():
        return chain
    table = physics.table
    return replace(chain, predictor=replace(chain.predictor, restitution=table.restitution, friction=table.friction))
