"""Where the time from light to command goes in the live rally, stage by stage, without and with a browser.

Simulation in a process of its own, the player of the app, serves of 5 to 9 m/s, at the pace of the clock. What lowers
the latency is switched off and on in turns, in one process, so that a busy machine meets both alike; ratios are of all
turns together. The window is not in it: half of it (1 ms) and the sensor's delay come before.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from app.shared.live_rally import LiveRally
from benchmarks.app.bare_browser import find_chromium, measuring_browser
from benchmarks.app.opened_rally import opened_rally, shown_rally, wait_until
from core.live.live_snapshot import STAGES
from core.live.urgency import NICENESS, TURN_S

SPEEDS_MPS: Final = (5.0, 7.0, 9.0)
SETTLE_S: Final = 10.0
PYTHON_TURN_S: Final = 0.005
URGENT: Final = ("live-player", "racket-commands")
TO_SENT: Final = len(STAGES) - 1
"""Stages up to the sending of a command; the robot's answer comes after."""

Rows = list[tuple[float, ...]]
SETTINGS: Final = ("before", "turns", "priority", "frozen", "after")
"""Nothing; only short turns in the interpreter; only priority; only frozen garbage collection; all three."""


def measure_latency(turns: int, turn_s: float) -> dict[str, object]:
    """Stages of commands, ms, without a browser and with one that draws in software, if there is a Chromium.

    Each setting has so many turns of so many seconds, in turns with the others.

    Keys `alone` and `browser` (None without Chromium), each with a value for each of `SETTINGS`: the number of
    commands, `window_to_command` and each stage with p50, p99 and worst, and the garbage collector's pauses; `ratio` of
    each setting to `before`; `load` and `priority_allowed`, whether the system allows it.
    """
    found: dict[str, object] = {"alone": _without_browser(turns, turn_s), "browser": None}
    if find_chromium() is not None:
        found["browser"] = _with_browser(turns, turn_s)
    return found


def _without_browser(turns: int, turn_s: float) -> dict[str, object]:
    with opened_rally(SPEEDS_MPS[0]) as live:
        return _measure(live, turns, turn_s)


def _with_browser(turns: int, turn_s: float) -> dict[str, object]:
    with (
        tempfile.TemporaryDirectory() as folder,
        measuring_browser() as browser,
        shown_rally(browser, Path(folder), SPEEDS_MPS[0]) as (live, _),
    ):
        return _measure(live, turns, turn_s)


def _measure(live: LiveRally, turns: int, turn_s: float) -> dict[str, object]:
    sends = lambda: live.player.snapshot.health.commands_sent > 0  # noqa: E731
    wait_until(sends, "the live rally sent no command", where="bench rally --latency")
    time.sleep(SETTLE_S)
    rows: dict[str, Rows] = {name: [] for name in SETTINGS}
    pauses: dict[str, list[float]] = {name: [] for name in SETTINGS}
    allowed = False
    for _ in range(turns):
        for name in SETTINGS:
            allowed |= _use(name)
            taken = live.player.meter.command_stages_ms
            with collector_pauses(pauses[name]):
                taken.clear()
                for speed_mps in SPEEDS_MPS:
                    assert live.simulation is not None
                    live.simulation.auto_serve(speed_mps)
                    time.sleep(turn_s / len(SPEEDS_MPS))
                rows[name] += list(taken)
    _use("after")
    settings = {name: summary_of(rows[name]) | {"collector_ms": spread(pauses[name])} for name in SETTINGS}
    return {
        **settings,
        "ratio": {name: ratio_of(rows[name], rows["before"]) for name in SETTINGS[1:]},
        "load": os.getloadavg()[0],
        "priority_allowed": allowed,
    }


def _use(setting: str) -> bool:
    """Switch on what the setting has, and off what it has not; whether the system lets threads go first."""
    every = setting == "after"
    sys.setswitchinterval(TURN_S if every or setting == "turns" else PYTHON_TURN_S)
    gc.unfreeze()
    gc.collect()
    if every or setting == "frozen":
        gc.freeze()
    niceness = NICENESS if every or setting == "priority" else 0
    try:
        for thread in threading.enumerate():
            if thread.name in URGENT and thread.native_id is not None and sys.platform == "linux":
                os.setpriority(os.PRIO_PROCESS, thread.native_id, niceness)
    except OSError:
        return False
    return True


@contextmanager
def collector_pauses(into_ms: list[float]) -> Iterator[None]:
    """Note how long the garbage collector stops the process, ms, while it is open."""
    began_s = [0.0]

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            began_s[0] = time.perf_counter()
        else:
            into_ms.append(1e3 * (time.perf_counter() - began_s[0]))

    gc.callbacks.append(note)
    try:
        yield
    finally:
        gc.callbacks.remove(note)


def spread(values: Rows | list[float]) -> dict[str, float | None]:
    """p50, p99 and the worst of durations; None without one. nan is left out."""
    known = np.array(values, np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return {"p50": None, "p99": None, "worst": None}
    p50, p99 = np.percentile(known, (50, 99)).tolist()
    return {"p50": p50, "p99": p99, "worst": float(known.max())}


def to_sent_ms(rows: Rows) -> list[float]:
    """From the end of the window to the sending of each command."""
    return np.array(rows, np.float64).reshape(-1, len(STAGES))[:, :TO_SENT].sum(axis=1).tolist()


def summary_of(rows: Rows) -> dict[str, object]:
    """The number of commands, and the spread of each stage and of all up to the sending, ms."""
    columns = np.array(rows, np.float64).reshape(-1, len(STAGES)).T
    stages = {name: spread(column.tolist()) for name, column in zip(STAGES, columns, strict=True)}
    return {"commands": len(rows), "window_to_command": spread(to_sent_ms(rows)), "stages": stages}


def ratio_of(rows: Rows, before: Rows) -> dict[str, float | None]:
    """p50 and p99 of window to command over those before; None where one is unknown."""
    mine, other = spread(to_sent_ms(rows)), spread(to_sent_ms(before))
    return {
        name: None if (value := mine[name]) is None or not (base := other[name]) else value / base
        for name in ("p50", "p99")
    }
