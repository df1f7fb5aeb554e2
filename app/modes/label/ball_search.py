"""Where the ball is at a time that nothing was labelled or proposed near: what the detector of Tune finds there."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

from app.background.jobs import LatestWins
from app.modes.label.labelling import Point
from core.detection.saved import SavedDetector
from core.metrics.run import answer_window
from core.recordings import CameraStream

NOT_FOUND: Final = "the detector finds no ball here"


@dataclass(frozen=True, slots=True, eq=False)
class BallRequest:
    """One time of one camera."""

    stream: CameraStream
    t_us: int
    detector: SavedDetector


def find_ball(request: BallRequest) -> Point | None:
    """Position of the ball, px; None if the detector finds none."""
    ball = answer_window(request.stream, *request.detector, request.t_us).detection
    return None if ball is None else (ball.u_px, ball.v_px)


class BallSearch:
    """Searches in the background; the newest request wins. Called by the loop; so is `found` with what was found."""

    def __init__(
        self,
        pool: Executor,
        later: Callable[[Callable[[], None]], None],
        found: Callable[[Point], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._later, self._found = later, found
        self._work = LatestWins(pool, find_ball, self._done, failed)
        self._wanted: BallRequest | None = None
        self.is_missing = False
        """Whether nothing was found at the place of the cursor."""

    def want(self, request: BallRequest | None) -> None:
        """Search here; None: it is known where the ball is, or nobody follows it."""
        self._wanted, self.is_missing = request, False
        if request is not None:
            self._work.submit(request)

    def close(self) -> None:
        """Stop searching."""
        self._wanted = None
        self._work.close()

    def _done(self, request: BallRequest, point: Point | None) -> None:
        self._later(lambda: self._use(request, point))

    def _use(self, request: BallRequest, point: Point | None) -> None:
        if request is not self._wanted:  # the cursor is elsewhere by now
            return
        self.is_missing = point is None
        if point is not None:
            self._found(point)
