"""Trainings here run as in a process of their own: with one thread."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from core.jobs.control import one_torch_thread
from core.learning.config import RunConfig


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> Iterator[None]:
    import torch  # noqa: F401  # also where the one file that is run does not

    with one_torch_thread():
        yield


@pytest.fixture
def check_it_goes_on_to_the_bit() -> Callable[[RunConfig, int, int], None]:
    """Whether seed 3 of a run, taken up after some balls, has the policy of one without a break, some balls later."""
    from core.learning.runs.training import Training

    def check(config: RunConfig, before: int, later: int) -> None:
        whole = Training(config, 3)
        for _ in range(before):
            whole.play_episode()
        arrays, about = whole.to_checkpoint()
        copies = {name: array.copy() for name, array in arrays.items()}
        again = Training.from_checkpoint(config, 3, copies, about)
        for _ in range(later):
            whole.play_episode()
            again.play_episode()
        for one, other in zip(whole.policy.layers, again.policy.layers, strict=True):
            np.testing.assert_array_equal(one[0], other[0])
            np.testing.assert_array_equal(one[1], other[1])

    return check
