"""The windows of one stretch of several cameras' events, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from core.detection.window import windows_side_by_side
from core.events import Events, Window


def block_windows(
    events: Mapping[str, Events], start_us: int, end_us: int, window_us: int
) -> Iterator[dict[str, Window]]:
    """Window after window of every camera over [start_us, end_us)."""
    sources = {name: _BlockEvents(one) for name, one in events.items()}
    return windows_side_by_side(sources, start_us, end_us, window_us)


@dataclass(frozen=True, slots=True, eq=False)
class _BlockEvents:
    """One camera's events, as a source of windows."""

    events: Events

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)
