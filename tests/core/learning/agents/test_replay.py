"""What a new stage keeps."""

import numpy as np
import pytest

from core.learning.agents.replay import COLUMNS, ReplayBuffer, start_stage
from core.learning.config import CurriculumConfig, ReplayRule

pytestmark = pytest.mark.numeric
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
    assert (kept.kept, kept.dropped) == (len(rows), len(REWARDS) - len(rows))
    assert kept.cases == tuple((i, int(i in rows), int(i not in rows)) for i in range(len(REWARDS)))  # a case each
    np.testing.assert_array_equal(buffer.column("state")[:, 3], rows)
    np.testing.assert_array_equal(buffer.column("reward")[:, 0], np.float32([REWARDS[i] for i in rows]))


def test_a_reward_at_the_threshold_is_kept_though_it_is_stored_with_seven_digits() -> None:
    for keep_reward, rewards, kept in (
        (0.9, [0.9, 0.89999, 0.90001], [0, 2]),
        (1.0, [1.0, 1.0 - 1e-6, 1.0 - 1.2e-6], [0, 1]),  # a millionth is the last place of what is stored
        (-0.3, [-0.3, -0.30001, 0.0], [0, 2]),
    ):
        buffer = ReplayBuffer(3)
        for i, reward in enumerate(rewards):
            row = {name: np.full(width, float(i)) for name, width in COLUMNS.items()}
            buffer.add(row | {"reward": np.array([reward])})
        start_stage(buffer, CurriculumConfig(keep_reward=keep_reward))
        np.testing.assert_array_equal(buffer.column("state")[:, 0], kept)


def test_samples_are_drawn_evenly_with_replacement_and_in_no_order() -> None:
    buffer = filled()
    rows = buffer.sample(6000, np.random.default_rng(0))
    assert np.abs(np.bincount(rows) - 1000).max() < 5 * np.sqrt(6000 * (1 / 6) * (5 / 6))
    pairs = np.bincount(rows[:-1] * 6 + rows[1:], minlength=36)
    assert np.abs(pairs - 6000 / 36).max() < 5 * np.sqrt(6000 / 36), "the next one does not depend on the last"
    batches = [buffer.sample(6, np.random.default_rng(seed)).tolist() for seed in range(20)]
    assert len(set(map(tuple, batches))) == 20 and any(len(set(batch)) < 6 for batch in batches)


def test_samples_come_from_all_rows_and_only_from_them() -> None:
    rows = filled().sample(2000, np.random.default_rng(0))
    assert set(rows.tolist()) == set(range(len(REWARDS)))


def test_a_restored_buffer_is_the_same() -> None:
    buffer, other = filled(), ReplayBuffer(10)
    other.restore(buffer.to_arrays())
    assert len(other) == len(buffer)
    for name in COLUMNS:
        np.testing.assert_array_equal(other.column(name), buffer.column(name))
