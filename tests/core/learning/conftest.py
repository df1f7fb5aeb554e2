"""Trainings here run as in a process of their own: with one thread."""

from collections.abc import Iterator

import pytest

from core.jobs.threads import one_torch_thread


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> Iterator[None]:
    import torch  # noqa: F401  # also where the one file that is run does not

    with one_torch_thread():
        yield
