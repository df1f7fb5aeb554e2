"""The newest moment of a live rally is kept once the block after it has come."""

import threading
from types import SimpleNamespace

import pytest

import app.modes.live_copy as live_copy
from app.shared.workspace import Workspace
from core.errors import RecordingError


class Growing:
    """Goes on by a block every third time that it is asked."""

    asked = 0

    @property
    def duration_us(self) -> int:
        self.asked += 1
        return 500_000 + 10_000 * (self.asked // 3)


def test_it_waits_for_the_next_block() -> None:
    assert live_copy._end_us(Growing(), 500_000, lambda: False) == 510_000  # type: ignore[arg-type]
    assert live_copy._end_us(Growing(), 400_000, lambda: False) == 500_000  # type: ignore[arg-type]


def test_a_copy_that_cannot_begin_keeps_no_name(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    host = SimpleNamespace(later=None, services=SimpleNamespace(workspace=Workspace(tmp_path)))
    copy = live_copy.LiveCopy(host)  # type: ignore[arg-type]
    rally = SimpleNamespace(start_us=0, duration_us=500_000)

    def no_thread(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", no_thread)
    with pytest.raises(RuntimeError):
        copy.begin(rally, 400_000, 2000, lambda: None)  # type: ignore[arg-type]
    assert not list((tmp_path / "recordings").iterdir())


def test_of_a_clock_that_stands_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_copy, "NEXT_BLOCK_S", 0.05)
    with pytest.raises(RecordingError, match="press Run"):
        live_copy._end_us(SimpleNamespace(duration_us=500_000), 500_000, lambda: False)  # type: ignore[arg-type]
