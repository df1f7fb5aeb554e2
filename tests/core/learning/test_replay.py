"""What a new stage keeps."""

import numpy as np
import pytest

from core.learning.config import CurriculumConfig, ReplayRule
from core.learning.replay import COLUMNS, Kept, ReplayBuffer, start_stage

REWARDS = [-1.0, 0.0, 1.0, 0.9, 3.5, -0.2]


def filled() -> ReplayBuffer:
    buffer = ReplayBuffer(10)
    for i, reward in enumerate(REWARDS):
        row = {name: np.full(width, float(i)) for name, width in COLUMNS.items()}
        buffer.add(row | {"reward": np.array([reward])})
    return buffer


@pytest.mark.parametrize(("rule", "rows"), [("threshold", [2, 4]), ("discard", []), ("retain", [0, 1, 2, 3, 4, 5])])
def test_a_stage_starts_with_what_its_rule_keeps(rule: ReplayRule, rows: list[int]) -> None:
    buffer = filled()
    kept = start_stage(buffer, CurriculumConfig(replay=rule))
    assert kept == Kept(len(rows), len(REWARDS) - len(rows))
    np.testing.assert_array_equal(buffer.column("state")[:, 3], rows)
    np.testing.assert_array_equal(buffer.column("reward")[:, 0], np.float32([REWARDS[i] for i in rows]))


def test_samples_come_from_all_rows_and_only_from_them() -> None:
    rows = filled().sample(2000, np.random.default_rng(0))
    assert set(rows.tolist()) == set(range(len(REWARDS)))


def test_a_restored_buffer_is_the_same() -> None:
    buffer, other = filled(), ReplayBuffer(10)
    other.restore(buffer.to_arrays())
    assert len(other) == len(buffer)
    for name in COLUMNS:
        np.testing.assert_array_equal(other.column(name), buffer.column(name))
