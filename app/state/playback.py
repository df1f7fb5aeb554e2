"""The time cursor of one browser: a pure value that gives its position at any wall-clock time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

SPEEDS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
SHORTEST_LOOP_US: Final = 100
STEPS_US: Final = (1, 10, 100, 500, 1_000, 2_000, 5_000, 10_000, 100_000, 1_000_000)


@dataclass(frozen=True, slots=True)
class Playhead:
    """Where in a recording the end of the shown window is; while it plays it moves with the wall clock."""

    duration_us: int
    anchor_us: int = 0
    """Position at `anchor_wall_s`; the position as long as it is paused."""
    anchor_wall_s: float = 0.0
    playing: bool = False
    speed: float = 0.05
    start_us: int = 0
    """Start of the available time; above 0 in a live recording only."""
    live: bool = False
    """Whether the recording is live: at its end the cursor follows it instead of stopping."""
    following: bool = False
    """Whether the cursor follows the end of a live recording."""
    loop_us: tuple[int, int] | None = None
    """Start and end of a section that is repeated once the cursor is in it."""

    def position_us(self, wall_s: float) -> int:
        """Position at a wall-clock time, in [start, duration]."""
        if self.following:
            return self.duration_us
        moved = self.speed * (wall_s - self.anchor_wall_s) * 1e6 if self.playing else 0.0
        return self._inside(self._looped(self.anchor_us + moved))

    def grown(self, start_us: int, duration_us: int) -> Playhead:
        """Cursor after a live recording has grown."""
        return replace(self, start_us=start_us, duration_us=duration_us)

    def seek(self, t_us: int, wall_s: float) -> Playhead:
        """Cursor at another time; playing or paused as before."""
        return replace(self, anchor_us=self._inside(t_us), anchor_wall_s=wall_s, following=False)

    def looping(self, section_us: tuple[int, int] | None, wall_s: float) -> Playhead:
        """The cursor with a section to repeat, moved to its start if it is outside; None ends the loop."""
        head = replace(self.seek(self.position_us(wall_s), wall_s), loop_us=None)
        if section_us is None:
            return head
        start_us, end_us = (head._inside(t_us) for t_us in sorted(section_us))
        if end_us - start_us < SHORTEST_LOOP_US:
            return head
        here_us = head.anchor_us if start_us <= head.anchor_us < end_us else start_us
        return replace(head, loop_us=(start_us, end_us), anchor_us=here_us)

    def _looped(self, t_us: float) -> float:
        if self.loop_us is None or not self.playing:
            return t_us
        start_us, end_us = self.loop_us
        inside = start_us <= self.anchor_us < end_us <= t_us
        return start_us + (t_us - start_us) % (end_us - start_us) if inside else t_us

    def _inside(self, t_us: float) -> int:
        return int(min(max(t_us, self.start_us), self.duration_us))

    def step(self, by_us: int, wall_s: float) -> Playhead:
        """Cursor paused, `by_us` later."""
        return replace(self, playing=False).seek(self.position_us(wall_s) + by_us, wall_s)

    def play(self, wall_s: float) -> Playhead:
        """Cursor playing: from the start if it was at the end; a live recording is followed unless in slow motion."""
        if self.live and (self.speed >= 1 or self.position_us(wall_s) >= self.duration_us):
            return replace(self, playing=True, following=True)
        start_us = self.position_us(wall_s)
        if start_us >= self.duration_us:
            start_us = 0
        return replace(self.seek(start_us, wall_s), playing=True)

    def pause(self, wall_s: float) -> Playhead:
        """Cursor paused at its position."""
        return replace(self.seek(self.position_us(wall_s), wall_s), playing=False)

    def at_speed(self, speed: float, wall_s: float) -> Playhead:
        """The cursor moving at `speed` recording seconds per second."""
        if not (math.isfinite(speed) and speed > 0):
            return self
        return replace(self.seek(self.position_us(wall_s), wall_s), speed=speed)

    def settle(self, wall_s: float) -> Playhead:
        """Cursor after reaching the end: paused, or following a live recording."""
        if not self.playing or self.following or self.position_us(wall_s) < self.duration_us:
            return self
        return replace(self, following=True) if self.live else self.pause(wall_s)
