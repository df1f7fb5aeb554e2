"""Whether the live rally keeps up: seconds are judged as they passed, and a slow one is not averaged away."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.app import bare_browser, bench_app
from benchmarks.app.live_pace import PaceRun, PaceWatch, rows_of
from core.errors import CommandError


def test_each_second_has_its_pace_and_is_one_with_a_ball_if_it_flew_at_any_time() -> None:
    now_s = [0.0]
    watch = PaceWatch(clock=lambda: now_s[0])
    for now_s[0], t_us, phase in (
        (0.0, 0, "serve"), (0.5, 500_000, "idle"), (1.0, 1_000_000, "return"), (2.0, 1_500_000, "decided"),
        (3.0, 2_600_000, "serve"),
    ):  # fmt: skip
        watch.on_state(SimpleNamespace(t_us=t_us, phase=phase))
    assert watch.seconds == [(1.0, True), (0.5, False), (pytest.approx(1.1), True)]
    watch.begin()
    assert watch.seconds == []


def test_the_best_run_is_held_against_the_goals_and_its_slowest_second_too() -> None:
    slow = PaceRun(0.8, 0.5, 30.0, 80.0, 9.0, 0.2)
    rows = rows_of([slow, PaceRun(1.0, 0.7, 12.0, 45.0, 2.0, 0.0)])
    assert [row["met"] for row in rows] == [True, False, True, False]
    assert "0.80, 1.00" in str(rows[0]["note"]) and "load 2.0, steal 0.0 %" in str(rows[0]["note"])
    assert not any(row["met"] for row in rows_of([slow]))


def test_without_a_browser_it_cannot_be_measured(monkeypatch) -> None:
    monkeypatch.setattr(bare_browser, "find_chromium", lambda: None)
    with pytest.raises(CommandError, match="no Chromium"):
        bench_app.run(lambda share: None, only="pace")
