"""Cutting streams of events, of one camera or several side by side, into consecutive windows for a detector."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from core.config import check_settings, setting
from core.detection.detector import Detection
from core.errors import ConfigError
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


SHORTEST_US: Final = 250
"""Windows by events or by motion are at least this long: a step of the detectors takes about as long, and windows that
end faster than they are computed only build a queue."""
VELOCITY_GAP_US: Final = 20_000
"""Two answers farther apart do not give a velocity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowRule:
    """When a window ends: after a time, and before that after so many events, or after so much motion of the ball."""

    longest_us: int
    """No window is longer. Without the other two every window is as long as this."""
    events: int | None = None
    """A window ends when it has this many events; None: they are not counted."""
    motion_px: float | None = None
    """A window ends when the ball has moved this far, as fast as the last answers say; None: motion does not count.
    While the velocity is unknown a window is `longest_us` long."""

    def __post_init__(self) -> None:
        for name, value in (("longest_us", self.longest_us), ("events", self.events), ("motion_px", self.motion_px)):
            if value is not None and not value > 0:
                raise ConfigError("a window of no length", expected="above 0", got=value, where=name)


@dataclass(frozen=True, slots=True, kw_only=True)
class EarlyEnds:
    """What ends windows before their time, whatever the longest ones of a method are; nothing by default."""

    events: int | None = None
    """See `WindowRule`; so the other."""
    motion_px: float | None = None

    def within(self, longest_us: int) -> WindowRule:
        """The rule with windows of at most that length.

        Raises:
            ConfigError: if a window would have no length.
        """
        return WindowRule(longest_us=longest_us, events=self.events, motion_px=self.motion_px)

    @property
    def words(self) -> str:
        """Such as "after 500 events or 1 px of motion"; empty if windows last as long as they are."""
        events = [] if self.events is None else [f"{self.events} events"]
        motion = [] if self.motion_px is None else [f"{self.motion_px:g} px of motion"]
        ends = " or ".join([*events, *motion])
        return f"after {ends}" if ends else ""


WHOLE: Final = EarlyEnds()
"""Windows of the method's own length."""


class ImageMotion:
    """How fast the ball moves in the picture, by a detector's last answers."""

    def __init__(self) -> None:
        self._last: Detection | None = None
        self._speed_px_per_ms: float | None = None

    def add(self, found: Detection | None) -> None:
        """Take the answer to a window. The method's own velocity counts if it has one."""
        if found is None:
            return
        own, last = getattr(found, "velocity_px_per_ms", None), self._last
        self._last, self._speed_px_per_ms = found, None
        if own is not None:
            self._speed_px_per_ms = float(np.hypot(*own))
        elif last is not None and 0 < found.t_us - last.t_us <= VELOCITY_GAP_US:
            moved_px = float(np.hypot(found.u_px - last.u_px, found.v_px - last.v_px))
            self._speed_px_per_ms = 1e3 * moved_px / (found.t_us - last.t_us)

    def speed_px_per_ms(self, now_us: int) -> float | None:
        """Speed at a time; None where it is unknown or its answer is too old."""
        known = self._last is not None and now_us - self._last.t_us <= VELOCITY_GAP_US
        return self._speed_px_per_ms if known else None


def windows_by_rule(
    source: SliceableEvents, start_us: int, end_us: int, rule: WindowRule, motion: ImageMotion
) -> Iterator[Window]:
    """Complete windows in [start_us, end_us) that end by a rule, in order and without gaps; empty ones too.

    Args:
        source: events of one camera.
        start_us: start of the first window.
        end_us: no window ends later.
        rule: when a window ends.
        motion: is asked at the beginning of each window; the caller adds each answer before it takes the next window.
    """
    shortest_us = min(SHORTEST_US, rule.longest_us)
    while start_us < end_us:
        length_us = rule.longest_us
        speed = None if rule.motion_px is None else motion.speed_px_per_ms(start_us)
        if rule.motion_px is not None and speed:
            length_us = int(min(max(1e3 * rule.motion_px / speed, shortest_us), length_us))
        events = source.slice(start_us, min(start_us + length_us, end_us))
        if rule.events is not None and len(events) > rule.events:
            # Before the first event too many: a window is half-open.
            length_us = max(shortest_us, int(events.t_us[rule.events]) - start_us)
        if start_us + length_us > end_us:
            return
        yield Window(events.between(start_us, start_us + length_us), start_us, start_us + length_us)
        start_us += length_us


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
