"""What a chain is told of the physics."""

from dataclasses import replace

import pytest

from core.chain.config import ChainConfig, chain_for_physics
from core.physics.config import physics_profile

pytestmark = pytest.mark.numeric


def test_the_paper_s_physics_changes_nothing_and_another_one_brings_its_table() -> None:
    chain = ChainConfig()
    known = replace(chain, filter=replace(chain.filter, perhaps_real=False))
    assert chain_for_physics(chain, physics_profile("paper")) == known
    told = chain_for_physics(chain, physics_profile("real"))
    assert (told.predictor.restitution, told.predictor.friction) == (0.945, 0.227)
    assert told.predictor.observations == chain.predictor.observations and told.detector == chain.detector
    assert (told.filter.drag, told.filter.restitution, told.filter.friction) == (0.554, 0.945, 0.227)
    assert told.filter.spin_sigma_radps > chain.filter.spin_sigma_radps and told.filter.noise_m == chain.filter.noise_m
