"""The 3D scene of a training in one browser: its balls, one after another, among the spots where others came down."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from app.modes.train.rally_player import SPEEDS, RallyPlayer
from app.modes.train.scene_panel import ScenePanel
from app.modes.train.view import Details
from app.shared.policies import PLAYERS, Player
from app.shared.training.replay import Replay
from core.history.rally_picture import RallyPicture
from core.learning.config import RunConfig

if TYPE_CHECKING:
    from app.modes.mode import ModeHost  # the modes import this file

DRAW_EVERY_S: Final = 1 / 40
LAYERS: Final = frozenset({"Ball", "Trail", "Racket", "Racket target", "Landing target", "Landing spots"})
"""Of the scene: nothing is seen by cameras or predicted here."""


class TrainingScene:
    """With its controls; what they ask for is done in the loop, and so is everything that the mode asks for."""

    def __init__(self, host: ModeHost, failed: Callable[[Exception], None]) -> None:
        self._host = host
        self._rally = RallyPlayer(host.pool, host.later, failed)
        self._panel = ScenePanel(host.client.gui, self)
        self._panel.show_speed("1")
        self._spots = True
        self._drawn_s = float("-inf")

    @property
    def replay(self) -> Replay | None:
        """The ball that flies."""
        return self._rally.replay

    def clear(self) -> None:
        """An empty table: nothing is trained, or another run is looked at."""
        self._rally.restart()
        self._panel.show_ball(None)
        self._host.world.layers = LAYERS
        self._host.world.draw(RallyPicture())

    def draw(self, wall_s: float, run: Path, config: RunConfig, details: Details) -> None:
        """Move the ball of a run, at most forty times a second."""
        if wall_s - self._drawn_s < DRAW_EVERY_S:
            return
        self._drawn_s = wall_s
        before = self._rally.replay
        self._rally.advance(wall_s, run, config, details.seed, details.recent)
        self._host.world.layers = LAYERS
        self._host.world.draw(self._rally.picture(wall_s, details.spots if self._spots else ()))
        if self._rally.replay is not before:
            self._panel.show_ball(self._rally.replay)
            self._panel.show_view(self._host.world.view)

    def close(self) -> None:
        """The browser is gone."""
        self._rally.close()

    # What a person asks for ---------------------------------------------------------------------------------------

    def play(self, player: str) -> None:
        """Choose whose balls fly."""
        if player in PLAYERS:
            chosen: Player = player
            self._host.later(lambda: self._rally.restart(chosen))

    def play_at(self, speed: str) -> None:
        """How fast balls are played."""
        if speed in SPEEDS:
            self._host.later(lambda: self._set_speed(speed))

    def _set_speed(self, speed: str) -> None:
        self._rally.set_speed(SPEEDS[speed])
        self._panel.show_speed(speed)

    def look_from(self, view: str) -> None:
        """Another point of view."""
        self._host.later(lambda: self._host.world.look_from(view))

    def show_spots(self, shown: bool) -> None:
        """Show or hide where balls came down."""
        self._host.later(lambda: self._set_spots(shown))

    def _set_spots(self, shown: bool) -> None:
        self._spots = shown
