"""The 3D scene of a training in one browser: its balls, one after another, and the controls of the scene."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import viser

from app.background.jobs import LatestWins
from app.modes.train.status import ball_html, no_ball_html, why_no_ball
from app.modes.train.view import Details
from app.scene.view_camera import VIEWPOINTS
from app.shared.rallies import PLAYERS, Player
from app.shared.trainer import RunState
from app.shared.training_records import Replay, ball_of_line, replay_ball
from app.widgets import Choice, when_changed
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
    """One episode's line, and which player replays it."""

    run: Path
    config: RunConfig
    seed: int
    line: Line
    player: Player


def make_replay(request: RallyRequest) -> Replay | None:
    """Replay of an episode; None if its line is incomplete."""
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
    """Chooses the next ball: the newest, or the last ones again while there is no newer one."""

    def __init__(self) -> None:
        self._newest: object = None
        self._again = 0

    def next_line(self, recent: Lines) -> Line | None:
        """Next of the newest lines, oldest first; None if there are none."""
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
        """Current replay."""
        return self._replay

    def close(self) -> None:
        """The browser has disconnected."""
        self._jobs.close()

    def restart(self, player: Player | None = None) -> None:
        """Restart for another run or player; the current and pending replays are dropped."""
        self._player = player or self._player
        self._order = BallOrder()
        self._replay = self._next = self._asked = None

    def set_speed(self, speed: float) -> None:
        """Set the speed; 1 is real time. The current ball continues."""
        now_s = time.monotonic()
        self._began_s = now_s - (now_s - self._began_s) * self._speed / speed
        self._speed = speed

    def advance(self, wall_s: float, run: Path, config: RunConfig, seed: int, recent: Lines) -> None:
        """Go on to the next ball when one has finished; it is requested shortly before, so that it is recent."""
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
        """Current moment."""
        if self._replay is None:
            return RallyPicture(spots=spots)
        return self._replay.picture((wall_s - self._began_s) * self._speed, spots)

    def _made(self, request: RallyRequest, replay: Replay | None) -> None:
        self._later(lambda: self._take(request, replay))

    def _take(self, request: RallyRequest, replay: Replay | None) -> None:
        if request is self._asked:
            self._asked, self._next = None, replay


VIEWS: Final = tuple(VIEWPOINTS)


class SceneActions(Protocol):
    """Actions of this panel."""

    def play(self, player: str) -> None: ...
    def play_at(self, speed: str) -> None: ...
    def look_from(self, view: str) -> None: ...
    def show_spots(self, shown: bool) -> None: ...


class ScenePanel:
    """The controls of the training's 3D scene, for one browser."""

    def __init__(self, gui: viser.GuiApi, actions: SceneActions) -> None:
        self._ball = gui.add_html(no_ball_html(""))
        self._player = gui.add_dropdown("Balls of", PLAYERS, hint="The same ball, with noise or as a policy plays it")
        self._view = gui.add_dropdown("View", VIEWS, hint="Drag to turn, wheel to zoom")
        self._speed = Choice(gui, "Speed", tuple(SPEEDS), actions.play_at, hint="Playback speed; 1 is real time")
        spots = gui.add_checkbox("Landing spots", True)
        when_changed(self._player, lambda player: actions.play(str(player)))
        when_changed(self._view, lambda view: actions.look_from(str(view)))
        when_changed(spots, lambda shown: actions.show_spots(bool(shown)))

    def show_ball(self, text: str) -> None:
        """Say which ball is shown, or why there is none."""
        if self._ball.content != text:
            self._ball.content = text

    def show_player(self, player: Player) -> None:
        """Show which player replays the balls."""
        self._player.value = player

    def show_view(self, view: str) -> None:
        """Show the current viewpoint."""
        if view in VIEWS:
            self._view.value = view

    def show_speed(self, speed: str) -> None:
        """Show the playback speed."""
        self._speed.show(speed)


if TYPE_CHECKING:
    from app.modes.mode import ModeHost  # the modes import this file

DRAW_EVERY_S: Final = 1 / 40
LAYERS: Final = frozenset({"Ball", "Trail", "Racket", "Racket target", "Landing target", "Landing spots"})
"""Layers of the training scene: nothing is seen by cameras or predicted here."""


class TrainingScene:
    """The training's 3D scene with its controls. All actions run in the loop."""

    def __init__(self, host: ModeHost, failed: Callable[[Exception], None]) -> None:
        self._host = host
        self._rally = RallyPlayer(host.pool, host.later, failed)
        self._panel = ScenePanel(host.client.gui, self)
        self._panel.show_speed("1")
        self._spots = True
        self._drawn_s = float("-inf")

    @property
    def replay(self) -> Replay | None:
        """Current replay."""
        return self._rally.replay

    def clear(self) -> None:
        """Clear the scene: nothing is trained, or another run was chosen."""
        self._rally.restart()
        self._panel.show_ball(no_ball_html(""))
        self._host.world.layers = LAYERS
        self._host.world.draw(RallyPicture())

    def explain(self, run: RunState | None, details: Details | None) -> None:
        """Say why there is no ball, while there is none."""
        if self._rally.replay is None:
            self._panel.show_ball(no_ball_html(why_no_ball(run, details)))

    def draw(self, wall_s: float, run: Path, config: RunConfig, details: Details) -> None:
        """Update a run's ball, at most forty times a second."""
        if wall_s - self._drawn_s < DRAW_EVERY_S:
            return
        self._drawn_s = wall_s
        before = self._rally.replay
        self._rally.advance(wall_s, run, config, details.seed, details.recent)
        self._host.world.layers = LAYERS
        self._host.world.draw(self._rally.picture(wall_s, details.spots if self._spots else ()))
        if self._rally.replay not in (None, before):
            self._panel.show_ball(ball_html(self._rally.replay))
            self._panel.show_view(self._host.world.view)

    def close(self) -> None:
        """The browser has disconnected."""
        self._rally.close()

    # Actions ---------------------------------------------------------------------------------------

    def play(self, player: str) -> None:
        """Choose which player replays the balls."""
        if player in PLAYERS:
            chosen: Player = player
            self._host.later(lambda: self._rally.restart(chosen))

    def let_policy_play(self) -> None:
        """Let the last policy replay the balls, without noise."""
        self._panel.show_player("current policy")
        self._rally.restart("current policy")

    def play_at(self, speed: str) -> None:
        """Show the playback speed."""
        if speed in SPEEDS:
            self._host.later(lambda: self._set_speed(speed))

    def _set_speed(self, speed: str) -> None:
        self._rally.set_speed(SPEEDS[speed])
        self._panel.show_speed(speed)

    def look_from(self, view: str) -> None:
        """Choose a viewpoint."""
        self._host.later(lambda: self._host.world.look_from(view))

    def show_spots(self, shown: bool) -> None:
        """Show or hide landing points."""
        self._host.later(lambda: self._set_spots(shown))

    def _set_spots(self, shown: bool) -> None:
        self._spots = shown
