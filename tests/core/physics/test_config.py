"""The profiles and that every constant reaches the physics."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.config import config_from_mapping, config_to_mapping, field_specs, load_config, save_config
from core.errors import ConfigError
from core.physics import PhysicsConfig, TaskConfig, physics_profile
from core.physics.config import AirConfig
from core.physics.task import task_profile
from core.table import REAL_DRAG, REAL_FRICTION, REAL_MAGNUS, REAL_RESTITUTION

pytestmark = pytest.mark.numeric


def test_the_default_is_the_paper_s_profile_without_air() -> None:
    assert PhysicsConfig() == physics_profile("paper")
    assert task_profile("paper") == TaskConfig()
    assert not physics_profile("paper").has_air
    assert physics_profile("real").has_air


def test_the_profile_real_has_what_was_fitted_to_recorded_flights() -> None:
    real = physics_profile("real")
    assert (real.air.drag_coefficient, real.air.magnus_coefficient) == (REAL_DRAG.value, REAL_MAGNUS)
    assert (real.table.restitution, real.table.friction) == (REAL_RESTITUTION.value, REAL_FRICTION.value)
    for constant in (REAL_DRAG, REAL_RESTITUTION, REAL_FRICTION):
        assert 0 < constant.sigma < 0.05 * constant.value


def test_profiles_survive_a_file(tmp_path: Path) -> None:
    task = task_profile("real")
    save_config(task, tmp_path / "task.toml")
    assert load_config(TaskConfig, tmp_path / "task.toml") == task
    assert config_from_mapping(TaskConfig, config_to_mapping(task), where="test") == task


def test_every_constant_of_the_physics_has_bounds_and_a_reason() -> None:
    for spec in field_specs(PhysicsConfig):
        assert spec.bounds is not None
        assert spec.doc, spec.path


def test_unknown_profiles_and_values_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"paper \| real"):
        physics_profile("moon")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match="drag_coefficient"):
        AirConfig(drag_coefficient=2.0)
