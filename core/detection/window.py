"""Cutting streams of events, of one camera or several side by side, into consecutive windows for a detector."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from core.config import check_settings, setting
from core.events import Events, Window


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowConfig:
    """Length of the detector's windows."""

    window_us: int = setting(2000, 50, 20_000, step=50)
    """Length of a window in microseconds. Long enough that the ball's edge sweeps about 3 pixels (thinner structures do
    not survive denoising), short enough that it sweeps less than a radius. 2000 suits image speeds of 1 to 4 px/ms."""

    def __post_init__(self) -> None:
        check_settings(self)


class SliceableEvents(Protocol):
    """Anything with time slices of events, such as one camera of a recording."""

    def slice(self, start_us: int, end_us: int) -> Events: ...


def windows_between(source: SliceableEvents, start_us: int, end_us: int, window_us: int) -> Iterator[Window]:
    """Complete windows of length `window_us` in [start_us, end_us), in order; empty ones too.

    Args:
        source: events of one camera.
        start_us: start of the first window.
        end_us: no window ends later.
        window_us: length of each.
    """
    for start in range(start_us, end_us - window_us + 1, window_us):
        yield Window(source.slice(start, start + window_us), start, start + window_us)


def windows_side_by_side(
    sources: Mapping[str, SliceableEvents], start_us: int, end_us: int, window_us: int
) -> Iterator[dict[str, Window]]:
    """Complete windows of several sources at once, by name.

    Args:
        sources: events of each camera, by name.
        start_us: start of the first window.
        end_us: no window ends later.
        window_us: length of each.
    """
    streams = [windows_between(source, start_us, end_us, window_us) for source in sources.values()]
    for windows in zip(*streams, strict=True):
        yield dict(zip(sources, windows, strict=True))


def block_windows(
    events: Mapping[str, Events], start_us: int, end_us: int, window_us: int
) -> Iterator[dict[str, Window]]:
    """Window after window of every camera over [start_us, end_us).

    Args:
        events: those of the block, by camera.
        start_us: start of the first window.
        end_us: no window ends later.
        window_us: length of each.
    """
    sources = {name: _BlockEvents(one) for name, one in events.items()}
    return windows_side_by_side(sources, start_us, end_us, window_us)


@dataclass(frozen=True, slots=True, eq=False)
class _BlockEvents:
    """One camera's events, as a source of windows."""

    events: Events

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)
