"""Data of a live rally besides events, as groups of rows like those of a recording: the last seconds."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np

from core.chain.control.decision import RacketDecision
from core.chain.control.player import PlayerState
from core.history.recorded_rally import (
    EPISODES,
    PREDICTIONS,
    RACKET,
    TARGETS,
    Rows,
    episode_rows,
    prediction_rows,
    racket_rows,
    target_rows,
)
from core.live.link import messages as m


class LiveRows:
    """Groups that grow at the end, with old rows dropped. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parts: dict[str, deque[tuple[int, Rows]]] = {}
        self._last: RacketDecision | None = None

    def clear(self) -> None:
        """Clear all rows."""
        with self._lock:
            self._parts.clear()
            self._last = None

    def read_rows(self, group: str) -> Rows | None:
        """All columns of a group, as of a recording in a file; None while there are no rows."""
        with self._lock:
            parts = [rows for _, rows in self._parts.get(group, ())]
        return {name: np.concatenate([rows[name] for rows in parts]) for name in parts[0]} if parts else None

    def add_state(self, state: m.WorldState) -> None:
        """Add the racket's poses of a state."""
        self._add(RACKET, state.t_us, racket_rows(state, 0))

    def add_step(self, state: PlayerState, decision: RacketDecision | None) -> None:
        """Add the prediction and decision of a step."""
        if state.chain.is_new and state.chain.prediction is not None:
            self._add(PREDICTIONS, state.chain.t_us, prediction_rows(state.chain.prediction, 0))
        if decision is not None:
            self._last = decision
            self._add(TARGETS, decision.t_us, target_rows(decision, 0))

    def add_outcome(self, notice: m.OutcomeNotice, policy: str) -> None:
        """Add the outcome of a ball."""
        last = self._last
        decision = last if last is not None and notice.serve_us <= last.t_us <= notice.t_us else None
        self._add(EPISODES, notice.t_us, episode_rows(notice, decision, policy, 0))

    def forget_before(self, t_us: int) -> None:
        """Drop old rows."""
        with self._lock:
            for parts in self._parts.values():
                while parts and parts[0][0] < t_us:
                    parts.popleft()

    def _add(self, group: str, t_us: int, rows: Rows | None) -> None:
        if rows is not None:
            with self._lock:
                self._parts.setdefault(group, deque()).append((t_us, rows))
