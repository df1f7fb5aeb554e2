"""A file's lists become tuples of the config, and what is no list of numbers is one clear line."""

from __future__ import annotations

import pytest

from core.config import config_from_mapping
from core.errors import ConfigError
from core.learning.config import RunConfig


@pytest.mark.parametrize(
    ("curriculum", "told"),
    [
        ({"speeds_mps": -1e300}, "not a list"),
        ({"speeds_mps": "xx"}, "not a list"),
        ({"speeds_mps": ["", 5.0]}, "not a list of such values"),
        ({"speeds_mps": [True, 5.0]}, "not a list of such values"),
        ({"speeds_mps": [3.0, float("nan")]}, "not a finite number"),
        ({"speeds_mps": [3, 10**400]}, "not a finite number"),
        ({"episodes": 3}, "not a list"),
        ({"episodes": [800.5, 900]}, "not a list of such values"),
        ({"episodes": [[800], 900]}, "not a list of such values"),
        ({"episodes": [800]}, "not one number of episodes per speed"),
    ],
)
def test_a_curriculum_that_is_none_is_one_line(curriculum: dict[str, object], told: str) -> None:
    with pytest.raises(ConfigError, match=told) as error:
        config_from_mapping(RunConfig, {"curriculum": curriculum}, where="run.toml")
    assert "\n" not in str(error.value) and "run.toml" in str(error.value)


def test_lists_of_a_file_are_tuples_of_the_config() -> None:
    config = config_from_mapping(RunConfig, {"curriculum": {"speeds_mps": [3, 5.5], "episodes": [1, 2]}}, where="x")
    assert config.curriculum.speeds_mps == (3.0, 5.5) and config.curriculum.episodes == (1, 2)
