"""What is loaded is set aside from the garbage collector, some times, and only once somebody looks at the app."""

import gc

import pytest

from app.server import AFTER_S, GcFreeze


@pytest.fixture(autouse=True)
def _thawed():
    yield
    gc.unfreeze()


def test_it_is_set_aside_some_times_after_the_first_browser_came(monkeypatch) -> None:
    loaded, frozen = GcFreeze(), []
    for second in range(400):
        monkeypatch.setattr(gc, "freeze", lambda second=second: frozen.append(second - 100))
        loaded.tick(1000.0 + second, busy=second in (100, 101))
    assert frozen == list(AFTER_S)


def test_it_is_out_of_the_collectors_sight() -> None:
    gc.unfreeze()
    loaded = GcFreeze()
    loaded.tick(0.0, busy=True)
    assert gc.get_freeze_count() == 0
    loaded.tick(AFTER_S[0], busy=True)
    assert gc.get_freeze_count() > 1000  # a Python with numpy has many more


def test_without_a_browser_nothing_is() -> None:
    gc.unfreeze()
    loaded = GcFreeze()
    for second in range(400):
        loaded.tick(float(second), busy=False)
    assert gc.get_freeze_count() == 0
