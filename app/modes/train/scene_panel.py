"""What the 3D view shows of a training: whose balls, how fast, from where."""

from __future__ import annotations

from typing import Final, Protocol

import viser

from app.modes.train.rally_player import SPEEDS
from app.modes.train.status import ball_html
from app.scene.viewpoints import VIEWPOINTS
from app.shared.policies import PLAYERS
from app.shared.training.replay import Replay
from app.widgets import Choice, when_changed

VIEWS: Final = tuple(VIEWPOINTS)


class SceneActions(Protocol):
    """What a person may ask for here."""

    def play(self, player: str) -> None: ...
    def play_at(self, speed: str) -> None: ...
    def look_from(self, view: str) -> None: ...
    def show_spots(self, shown: bool) -> None: ...


class ScenePanel:
    """The controls of the training's 3D scene, for one browser."""

    def __init__(self, gui: viser.GuiApi, actions: SceneActions) -> None:
        self._ball = gui.add_html(ball_html(None))
        self._player = gui.add_dropdown("Balls of", PLAYERS, hint="The same ball, with noise or as a policy plays it")
        self._view = gui.add_dropdown("View", VIEWS, hint="Drag to turn, wheel to zoom")
        self._speed = Choice(gui, "Speed", tuple(SPEEDS), actions.play_at, hint="Of the ball; 1 is real time")
        spots = gui.add_checkbox("Landing spots", True)
        when_changed(self._player, lambda player: actions.play(str(player)))
        when_changed(self._view, lambda view: actions.look_from(str(view)))
        when_changed(spots, lambda shown: actions.show_spots(bool(shown)))

    def show_ball(self, replay: Replay | None) -> None:
        """Say which ball plays now."""
        self._ball.content = ball_html(replay)

    def show_view(self, view: str) -> None:
        """From where the scene is looked at now."""
        if view in VIEWS:
            self._view.value = view

    def show_speed(self, speed: str) -> None:
        """How fast balls are played."""
        self._speed.show(speed)
