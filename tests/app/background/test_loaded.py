"""What is loaded is set aside from the garbage collector, some times, and only once somebody looks at the app."""

import gc

import pytest

from app.background.loaded import AFTER_S, LoadedObjects


@pytest.fixture(autouse=True)
def _thawed():
    yield
    gc.unfreeze()


def test_it_is_set_aside_some_times_after_the_first_browser_came() -> None:
    loaded, frozen = LoadedObjects(), []
    gc.unfreeze()
    for second in range(400):
        loaded.tick(1000.0 + second, busy=second in (100, 101))
        if gc.get_freeze_count() and gc.get_freeze_count() != (frozen[-1][1] if frozen else 0):
            frozen.append((second - 100, gc.get_freeze_count()))
    assert [seconds for seconds, _ in frozen] == list(AFTER_S)
    assert frozen[0][1] > 1000  # a Python with numpy has many more


def test_without_a_browser_nothing_is() -> None:
    gc.unfreeze()
    loaded = LoadedObjects()
    for second in range(400):
        loaded.tick(float(second), busy=False)
    assert gc.get_freeze_count() == 0
