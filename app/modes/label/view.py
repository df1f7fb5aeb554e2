"""What a person in Label mode has chosen, as one frozen value, and the times that are to be labelled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.state.playback import STEPS_US

WINDOWS_US: Final = (500, 1_000, 2_000, 5_000, 10_000)
"""Keys 1 to 5."""
ZOOMS: Final = (1.0, 5.0, 10.0, 20.0)
"""Keys 6 to 9."""
LABEL_STEPS_US: Final = tuple(step for step in STEPS_US if 500 <= step <= 100_000)
DEFAULT_STEP_US: Final = 2_000
NUDGE_PX: Final = 0.25
BIG_NUDGE_PX: Final = 1.0
RADIUS_STEP_PX: Final = 0.25
DEFAULT_ANNOTATOR: Final = "annotator"


@dataclass(frozen=True, slots=True)
class LabelView:
    """What one browser looks at in Label."""

    camera: str = ""
    annotator: str = DEFAULT_ANNOTATOR
    window_us: int = 2_000
    zoom: float = 1.0
    snap: bool = True
    """Move clicks to the circle that fits the events."""
    advance: bool = False
    """Go on after each label that is made by a click or a key."""
    follow: bool = True
    """Keep the ball, as far as it is known, in the middle of a zoomed picture."""
    epipolar: bool = True
    """Show the other camera's ray, and how well the cameras agree."""
    centre_px: tuple[float, float] | None = None
    """Of a zoomed picture, where nothing is known of the ball."""
    blind: bool = False
    """A second look at a label, without seeing it."""


def window_around(t_us: int, window_us: int) -> tuple[int, int]:
    """The window whose middle is the label's time: a label is the ball at the middle of what is seen."""
    start_us = max(t_us - window_us // 2, 0)
    return start_us, max(t_us + (window_us + 1) // 2, start_us + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """The times that are to be labelled: those of the frames, or every so many microseconds."""

    duration_us: int
    step_us: int
    frames_us: NDArray[np.int64] | None = None

    def moved(self, t_us: int, steps: int) -> int:
        """The time so many steps on (or back) from any time; stays inside."""
        if self.frames_us is not None:
            if not len(self.frames_us):
                return t_us
            at = int(np.searchsorted(self.frames_us, t_us, side="right" if steps > 0 else "left"))
            row = at - 1 + steps if steps > 0 else at + steps
            return int(self.frames_us[min(max(row, 0), len(self.frames_us) - 1)])
        number = t_us // self.step_us if steps > 0 else -(-t_us // self.step_us)
        return min(max((number + steps) * self.step_us, 0), self.last_us)

    @property
    def last_us(self) -> int:
        """The last time that can be labelled."""
        if self.frames_us is not None:
            return int(self.frames_us[-1]) if len(self.frames_us) else 0
        return max(self.duration_us - 1, 0) // self.step_us * self.step_us

    def times(self) -> NDArray[np.int64]:
        """All times that can be labelled."""
        if self.frames_us is not None:
            return self.frames_us
        return np.arange(0, self.last_us + 1, self.step_us, dtype=np.int64)
