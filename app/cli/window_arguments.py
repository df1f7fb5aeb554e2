"""`--window-events` and `--window-px`: windows that end before their time, and how long they were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.cli.arguments import PositiveFloat, PositiveInt, flag, given
from core.detection.window import SHORTEST_US, EarlyEnds, WindowRule
from core.errors import CommandError
from core.metrics import WindowAnswers


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowArguments:
    """When a window ends before its time; with both flags, what comes first."""

    window_events: PositiveInt | None = flag(
        f"end a window after N events; at least {SHORTEST_US} us, at most as long as without", "N", "never"
    )
    window_px: PositiveFloat | None = flag(
        f"end a window when the ball has moved by X pixels; at least {SHORTEST_US} us, at most as long as without",
        "X",
        "never",
    )

    @property
    def ends(self) -> EarlyEnds:
        """What ends a window."""
        return EarlyEnds(events=self.window_events, motion_px=self.window_px)

    def refuse(self, why: str, remedy: str) -> None:
        """Raises CommandError if one was given."""
        for name, value in given({"window-events": self.window_events, "window-px": self.window_px}).items():
            raise CommandError(why, got=value, where=f"--{name}", remedy=remedy)


def window_lengths(rule: WindowRule, answers: WindowAnswers) -> dict[str, object]:
    """The rule beside the longest window, and how long windows were, us; empty where all are equally long."""
    if rule.events is None and rule.motion_px is None:
        return {}
    lengths_us = np.diff(answers.end_us, prepend=0)
    low, median, high = np.percentile(lengths_us, (5, 50, 95)).tolist() if len(lengths_us) else (None, None, None)
    return {
        "window_events": rule.events,
        "window_px": rule.motion_px,
        "window_length_us": {"p5": low, "median": median, "p95": high},
    }


def length_words(summary: Mapping[str, object]) -> str:
    """How long the windows of a summary are."""
    lengths, longest = summary.get("window_length_us"), f"{summary['window_us']} us"
    return f"at most {longest}, median {lengths['median']} us" if isinstance(lengths, dict) else longest
