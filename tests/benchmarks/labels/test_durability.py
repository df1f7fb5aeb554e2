from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.labels.durability import (
    LAYER,
    kill_while_labelling,
    open_cpu_seconds,
    undo_everything,
    write_in_a_crowd,
    write_seconds,
)


def test_no_acknowledged_label_is_lost_when_the_process_is_killed_again_and_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    results = [kill_while_labelling(tmp_path, float(rng.uniform(0.0, 0.05))) for _ in range(4)]
    assert sum(result.acknowledged for result in results) >= 4
    assert all(result.readable and result.resumed for result in results)
    assert [result.lost for result in results] == [0, 0, 0, 0]


def test_the_kill_trial_notices_lost_labels_and_unreadable_stores(tmp_path: Path) -> None:
    assert kill_while_labelling(tmp_path, 0.02).lost == 0
    path = LAYER.path(tmp_path)
    path.rename(path.with_suffix(".away"))
    path.mkdir()  # what was acknowledged is gone, and nothing can be written
    result = kill_while_labelling(tmp_path, 0.0)
    assert not result.readable


def test_random_operations_undone_completely_give_the_empty_state(tmp_path: Path) -> None:
    left, redone = undo_everything(tmp_path, 400, np.random.default_rng(2))
    assert left == 0
    assert redone


def test_a_durable_label_does_not_cost_more_when_there_are_many(tmp_path: Path) -> None:
    few, many = write_seconds(tmp_path, 50, already=0), write_seconds(tmp_path, 50, already=5000)
    assert np.median(many) < 10 * np.median(few) + 0.005


def test_several_programs_write_one_store_at_once_and_nothing_is_lost_or_doubled(tmp_path: Path) -> None:
    crowd = write_in_a_crowd(tmp_path, 8, 25)
    assert (crowd.acknowledged, crowd.lost, crowd.doubled) == (200, 0, 0)


def test_opening_costs_far_less_than_making_an_object_of_every_label(tmp_path: Path) -> None:
    seconds = open_cpu_seconds(tmp_path, 20_000, times=3)
    assert np.median(seconds) < 0.25  # 20 times what 200,000 labels may take, for each label
