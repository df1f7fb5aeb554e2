"""Does the live rally keep up while a browser shows it: how fast its clock runs, and how soon a command is out."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from app.shared.live_rally import LiveRally
from benchmarks.app.bare_browser import measuring_browser
from benchmarks.app.opened_rally import shown_rally, wait_until
from benchmarks.machine import Row, goal_row
from core.live.link import messages as m

if TYPE_CHECKING:
    from playwright.sync_api import Browser

RUNS: Final = 5
RUN_S: Final = 60.0
SPEEDS_MPS: Final = (5.0, 6.0, 7.0, 8.0, 9.0)
"""Of the serves, in turns within each run."""
SETTLE_S: Final = 10.0
SECOND_S: Final = 1.0


@dataclass(slots=True)
class PaceWatch:
    """A listener of the rally: how far its clock goes in each second, and whether a ball flew in it."""

    clock: Callable[[], float] = time.monotonic
    seconds: list[tuple[float, bool]] = field(default_factory=list)
    """Rally seconds per second of the wall clock, and whether a ball flew at any time of it."""
    _since: tuple[float, int] | None = None
    _flew: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self) -> None:
        """Forget what was seen."""
        with self._lock:
            self.seconds, self._since, self._flew = [], None, False

    def on_session(self, welcome: m.Reply) -> None:
        """Another clock."""
        self.begin()

    def on_events(self, batch: m.EventBatch) -> None:
        """They are not looked at."""

    def on_notice(self, notice: m.Notice) -> None:
        """Nor are they."""

    def on_state(self, state: m.WorldState) -> None:
        """Time goes on."""
        now_s = self.clock()
        with self._lock:
            self._flew |= state.phase in ("serve", "return")
            if self._since is None:
                self._since = now_s, state.t_us
                return
            since_s, since_us = self._since
            if now_s - since_s >= SECOND_S:
                self.seconds.append(((state.t_us - since_us) * 1e-6 / (now_s - since_s), self._flew))
                self._since, self._flew = (now_s, state.t_us), False


@dataclass(frozen=True, slots=True)
class PaceRun:
    """One run."""

    pace: float
    """Rally seconds per second."""
    least_with_ball: float
    """Of the seconds in which a ball flew; nan where there was none."""
    sent_p50_ms: float
    sent_p99_ms: float
    """From the end of a window to its command."""
    load: float
    steal: float
    """Share of the processors' time that other machines took, 0 to 1."""


def measure_pace(
    folder: Path, progress: Callable[[float], None], runs: int = RUNS, seconds: float = RUN_S
) -> list[Row]:
    """The best of some runs with Chromium at 1280x720, which draws in software.

    Raises:
        CommandError: if there is no browser, or the rally does not come up in it.
    """
    with measuring_browser() as browser:
        return measure_in(browser, folder, progress, runs, seconds)


def measure_in(
    browser: Browser,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
    runs: int = RUNS,
    seconds: float = RUN_S,
) -> list[Row]:
    """Measure in an open browser."""
    watch, found = PaceWatch(), []
    with shown_rally(browser, folder, SPEEDS_MPS[0]) as (live, _):
        live.source.add_listener(watch)
        problem = "the live rally did not come up in the browser"
        wait_until(lambda: live.player.snapshot.returned >= 1, problem, where="bench app --only pace")
        time.sleep(SETTLE_S)
        for number in range(runs):
            found.append(_run(live, watch, seconds))
            progress((number + 1) / runs)
    return rows_of(found)


def _run(live: LiveRally, watch: PaceWatch, seconds: float) -> PaceRun:
    assert live.simulation is not None
    before = _processor_times()
    watch.begin()
    for speed_mps in SPEEDS_MPS:
        live.simulation.auto_serve(speed_mps)
        time.sleep(seconds / len(SPEEDS_MPS))
    health, after = live.player.snapshot.health, _processor_times()
    paces = [pace for pace, _ in watch.seconds]
    with_ball = [pace for pace, flew in watch.seconds if flew]
    spent = after - before
    return PaceRun(
        float(np.mean(paces)) if paces else 0.0,
        min(with_ball, default=float("nan")),
        health.window_to_sent.p50_ms,
        health.window_to_sent.p99_ms,
        os.getloadavg()[0],
        float(spent[7] / max(spent[:8].sum(), 1)),
    )


def rows_of(runs: list[PaceRun]) -> list[Row]:
    """The best run against the goals, and how far the others are from it."""
    best = max(runs, key=lambda run: run.pace)
    others = ", ".join(f"{run.pace:.2f}" for run in runs)
    machine = f"load {best.load:.1f}, steal {100 * best.steal:.1f} %"
    return [
        goal_row("pace of the live rally, best run", best.pace, 1.0, "x", least=True, note=f"all: {others}; {machine}"),
        goal_row("its slowest second with a ball", best.least_with_ball, 0.9, "x", least=True),
        goal_row("window to command, p50", best.sent_p50_ms, 15, "ms"),
        goal_row("window to command, p99", best.sent_p99_ms, 40, "ms"),
    ]


def _processor_times() -> np.ndarray:
    """Ticks of all processors: user, nice, system, idle, iowait, irq, softirq, steal."""
    return np.array(Path("/proc/stat").read_text("utf-8").split("\n", 1)[0].split()[1:], np.int64)
