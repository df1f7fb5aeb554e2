"""Which ball plays in the 3D view: the newest one, whenever the last one has finished."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.background.worker import LatestWins
from app.shared.policies import Player
from app.shared.training.replay import Replay, ball_of_line, replay_ball
from core.history.rally_picture import LandingSpot, RallyPicture
from core.learning.agents.policy import read_policy
from core.learning.config import RunConfig
from core.learning.runs.run_files import seed_files

Line = dict[str, object]
Lines = tuple[Line, ...]
ASK_BEFORE_S: Final = 0.15
SPEEDS: Final[dict[str, float]] = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0}


@dataclass(frozen=True, slots=True, eq=False)
class RallyRequest:
    """One episode's line, and who is to play it."""

    run: Path
    config: RunConfig
    seed: int
    line: Line
    player: Player


def make_replay(request: RallyRequest) -> Replay | None:
    """The ball in play; None if its line does not tell enough."""
    ball = ball_of_line(request.line)
    if ball is None:
        return None
    files = seed_files(request.run, request.seed)
    path = files.best if request.player == "best so far" else files.policy
    if request.player == "training ball" or not path.exists():
        noise = "a random action" if ball.is_random else f"noise {ball.noise:.2f}"
        title = noise if request.player == "training ball" else f"{noise} (no policy is saved yet)"
        return replay_ball(ball, request.config.environment, None, title)
    return replay_ball(ball, request.config.environment, read_policy(path), f"{request.player}, no noise")


class BallOrder:
    """Which ball comes next: the newest one, and while there is no newer one the last ones over again."""

    def __init__(self) -> None:
        self._newest: object = None
        self._again = 0

    def next_line(self, recent: Lines) -> Line | None:
        """The next of the newest lines, oldest first; None if there are none."""
        if not recent:
            return None
        newest = recent[-1].get("episode")
        if newest != self._newest:
            self._newest, self._again = newest, 0
            return recent[-1]
        line = recent[self._again % len(recent)]
        self._again += 1
        return line


class RallyPlayer:
    """Plays a training's balls for one browser; its methods are called by the loop."""

    def __init__(
        self, pool: Executor, later: Callable[[Callable[[], None]], None], failed: Callable[[Exception], None]
    ) -> None:
        self._speed = 1.0
        self._player: Player = "training ball"
        self._later = later
        self._jobs = LatestWins(pool, make_replay, self._made, failed)
        self._order = BallOrder()
        self._replay: Replay | None = None
        self._began_s = 0.0
        self._asked: RallyRequest | None = None
        self._next: Replay | None = None

    @property
    def replay(self) -> Replay | None:
        """The replay that plays now."""
        return self._replay

    def close(self) -> None:
        """The browser is gone."""
        self._jobs.close()

    def restart(self, player: Player | None = None) -> None:
        """Another run, or another player: what plays, or is on its way, is not wanted any more."""
        self._player = player or self._player
        self._order = BallOrder()
        self._replay = self._next = self._asked = None

    def set_speed(self, speed: float) -> None:
        """1 is real time; the ball that plays goes on where it is."""
        now_s = time.monotonic()
        self._began_s = now_s - (now_s - self._began_s) * self._speed / speed
        self._speed = speed

    def advance(self, wall_s: float, run: Path, config: RunConfig, seed: int, recent: Lines) -> None:
        """Go on to the next ball where one has finished; it is asked for shortly before, so that it is a new one."""
        left_s = 0.0
        if self._replay is not None:
            left_s = self._replay.duration_s / self._speed - (wall_s - self._began_s)
        if left_s <= 0 and self._next is not None:
            self._replay, self._next, self._began_s = self._next, None, wall_s
        elif left_s <= ASK_BEFORE_S and self._asked is None and self._next is None:
            line = self._order.next_line(recent)
            if line is not None:
                self._asked = RallyRequest(run, config, seed, line, self._player)
                self._jobs.submit(self._asked)

    def picture(self, wall_s: float, spots: tuple[LandingSpot, ...]) -> RallyPicture:
        """The moment that is seen now."""
        if self._replay is None:
            return RallyPicture(spots=spots)
        return self._replay.picture((wall_s - self._began_s) * self._speed, spots)

    def _made(self, request: RallyRequest, replay: Replay | None) -> None:
        self._later(lambda: self._take(request, replay))

    def _take(self, request: RallyRequest, replay: Replay | None) -> None:
        if request is self._asked:
            self._asked, self._next = None, replay
