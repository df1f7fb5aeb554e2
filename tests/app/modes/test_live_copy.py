"""The newest moment of a live rally is kept once the block after it has come."""

from types import SimpleNamespace

import pytest

import app.modes.live_copy as live_copy
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


def test_of_a_clock_that_stands_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_copy, "NEXT_BLOCK_S", 0.05)
    with pytest.raises(RecordingError, match="press Run"):
        live_copy._end_us(SimpleNamespace(duration_us=500_000), 500_000, lambda: False)  # type: ignore[arg-type]
