"""The 3D view in Export: what is seen, and the pictures that the browser draws of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.export.unfinished import Cancelled, check_cancelled
from app.modes.mode import ModeHost
from app.scene.view_camera import GONE, ViewCamera, render_view
from app.scene.world import LAYERS
from app.shared.rallies import WatchedRally
from app.state.client_state import ClientState
from core.errors import CommandError
from core.history.rally_picture import RallyPicture

LEFT: Final = "the 3D view was left while it was being filmed: no film was made"
POLL_S: Final = 0.05


class ViewShots:
    """Pictures of one browser's 3D view. Called by its loop, except `picture_at`, which draws and waits."""

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._rally: WatchedRally | None = None
        self._drawn: object = None
        self._eye: ViewCamera | None = None
        self._ready: dict[int, RallyPicture] = {}
        self._lost = ""
        """Why no more pictures can be drawn."""

    @property
    def rally(self) -> WatchedRally | None:
        """What is shown; None if the recording cannot be seen in space."""
        return self._rally

    @property
    def running(self) -> bool:
        """A picture or a film is being made: the scene shows its moments, not those of the cursor."""
        return self._eye is not None

    def use(self, rally: WatchedRally | None) -> None:
        """Another recording was opened."""
        self.leave()
        self._rally, self._drawn = rally, None
        if rally is not None:
            self._host.world.use_cameras(rally.cameras)

    def draw(self, state: ClientState, now_us: int) -> None:
        """Show the moment of the cursor, unless one of a film is shown."""
        rally, world = self._rally, self._host.world
        if rally is None or self.running:
            return
        if state.playhead.following:
            now_us = min(now_us, rally.history.followed_us)
        key = (now_us, state.watch.hidden, rally.history.followed_us >= now_us, rally.history.outcome_count)
        if key != self._drawn:
            self._drawn = key
            world.layers = frozenset(LAYERS) - state.watch.hidden
            world.draw(rally.picture_at(now_us))

    def begin(self) -> None:
        """From here on the view is held, and its moments are those of `picture_at`.

        Raises:
            CommandError: if one is being made already.
        """
        if self.running:
            raise CommandError("this view is being drawn already", remedy="wait for it, or cancel it")
        self._lost, self._eye = "", self._host.world.eye
        self._host.world.hold(self._eye)

    def end(self) -> None:
        """Let the view go: the scene shows the moment of the cursor again."""
        self._eye, self._drawn = None, None
        self._ready = {}
        self._host.world.hold(None)

    def leave(self) -> None:
        """The view is not shown any more."""
        self._lost = self._lost or LEFT
        self._drawn = None

    def close(self) -> None:
        """The browser is gone."""
        self._lost = GONE

    def keep(self, times_us: tuple[int, ...], cancelled: Cancelled) -> None:
        """Work these moments out now where they will be forgotten: a live rally goes on. In the film's thread."""
        rally = self._rally
        if rally is not None and rally.live is not None:
            for t_us in times_us:
                check_cancelled(cancelled)
                self._ready[t_us] = rally.picture_at(t_us)

    def picture_at(self, t_us: int, size: tuple[int, int], cancelled: Cancelled) -> NDArray[np.uint8]:
        """(height, width, 3) RGB of a moment, `size` being width and height. In a thread of its own.

        Raises:
            CommandError: if the view was left, or the browser is gone or does not answer.
            ExportCancelledError: if `cancelled()` is true.
        """
        rally, eye = self._rally, self._eye
        assert rally is not None and eye is not None
        following = rally.following
        self._wait(lambda: following is None or following.history.followed_us >= t_us or rally.followed == 1, cancelled)
        picture = self._ready.pop(t_us, None) or rally.picture_at(t_us)
        drawn = threading.Event()

        def draw() -> None:
            self._host.world.draw(picture)
            drawn.set()

        self._host.later(draw)
        self._wait(drawn.is_set, cancelled)
        pixels = render_view(self._host.client, *size, eye)
        self._check()  # a view that was left meanwhile was empty
        return pixels

    def _wait(self, ready: Callable[[], bool], cancelled: Cancelled) -> None:
        while True:
            self._check()
            check_cancelled(cancelled)
            if ready():
                return
            time.sleep(POLL_S)

    def _check(self) -> None:
        if self._lost:
            raise CommandError(self._lost)
