from __future__ import annotations

from dataclasses import replace
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
from labels.store import LabelStore


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


def test_every_durable_write_is_timed_into_an_empty_store_and_into_a_large_one(tmp_path: Path) -> None:
    for already in (0, 5000):
        seconds = write_seconds(tmp_path, 50, already=already)
        assert seconds.shape == (50,) and (seconds > 0).all()
        written = LabelStore.read(tmp_path, replace(LAYER, annotator=f"cost-{already}"))
        assert len(written.labels()) == already + 50


def test_several_programs_write_one_store_at_once_and_nothing_is_lost_or_doubled(tmp_path: Path) -> None:
    crowd = write_in_a_crowd(tmp_path, 8, 25)
    assert (crowd.acknowledged, crowd.lost, crowd.doubled) == (200, 0, 0)


def test_every_opening_of_a_store_is_timed(tmp_path: Path) -> None:
    seconds = open_cpu_seconds(tmp_path, 2000, times=3)
    assert seconds.shape == (3,) and (seconds > 0).all()
