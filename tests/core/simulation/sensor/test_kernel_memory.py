"""Arrays without counts are the arrays themselves."""

from typing import NamedTuple

import numpy as np
import pytest

from core.jit import njit
from core.simulation.sensor.pixels import prefetch, uncounted

pytestmark = pytest.mark.numeric


class Pair(NamedTuple):
    left: np.ndarray
    right: np.ndarray


@njit
def add_one(pair, flags):
    pair, flags = uncounted(pair), uncounted(flags)
    for index in range(len(pair.left)):
        prefetch(pair.left, index + 3)
        pair.left[index] += pair.right[index, 1] if flags[index] else 0.0
    return pair.left.sum() + len(pair.right)


def test_a_kernel_writes_into_the_arrays_that_it_was_given() -> None:
    left, right = np.arange(5.0), np.ones((5, 2), np.float32)
    flags = np.array([True, False, True, True, False])
    assert add_one(Pair(left, right), flags) == 10 + 3 + 5
    assert left.tolist() == [1, 1, 3, 4, 4]


def test_arrays_live_on_after_the_kernel() -> None:
    for _ in range(1000):
        left = np.zeros(300)
        add_one(Pair(left, np.ones((300, 2), np.float32)), np.ones(300, np.bool_))
        assert (left == 1).all()


def test_nothing_in_an_empty_array() -> None:
    assert add_one(Pair(np.empty(0), np.empty((0, 2), np.float32)), np.empty(0, np.bool_)) == 0
