"""The event pictures in the middle of one browser: asked for when what they show changes, and drawn off the loop."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

from app.background.jobs import LatestWins
from app.state.client_state import ClientState
from app.views.image_view import ImageView
from app.views.mosaic import Mosaic
from app.views.requests import WatchRequest, render_watch
from core.metrics.playback import PlaybackAnswers
from core.recordings import Recording


class EventPictures:
    """Asks for the pictures of all cameras and shows them. Methods are called by the loop."""

    def __init__(
        self,
        pool: Executor,
        plane: ImageView,
        later: Callable[[Callable[[], None]], None],
        failed: Callable[[Exception], None],
        is_wanted: Callable[[], bool],
    ) -> None:
        """`later` runs a function in the loop; there `is_wanted` tells whether the pictures are still to be seen."""
        self._plane = plane
        self._later = later
        self._failed = failed
        self._is_wanted = is_wanted
        self._pictures = LatestWins(pool, render_watch, self._drawn, self._went_wrong)
        self._requested: object = None
        self._playback = PlaybackAnswers()

    def ask(self, state: ClientState, recording: Recording, now_us: int, wall_s: float) -> None:
        """Have the pictures at the time cursor drawn, if they are others than those that were asked for last."""
        detector, show_truth = state.detector, state.tune.show_truth
        key = (
            recording.uuid,
            now_us,
            state.look,
            detector,
            show_truth,
            state.watch.large,
            state.watch.table,
            state.watch.framed,
            self._plane.free_aspect if state.mode == "Export" else None,
            self._playback if state.playhead.is_playback else None,  # what stands is the same however one got there
            state.mode == "Watch",
            state.mode == "Watch" and not state.playhead.playing,  # what moves cannot be read
        )
        if key != self._requested:
            self._requested = key
            request = WatchRequest(recording, *key[1:])
            self._plane.freshness.ask(request, wall_s)
            self._pictures.submit(request)

    def forget(self) -> None:
        """Something else is shown in their place: the next ones are asked for whatever they show."""
        self._requested = None

    def close(self) -> None:
        """The browser has disconnected."""
        self._pictures.close()

    def _drawn(self, request: WatchRequest, sheet: Mosaic) -> None:
        self._later(lambda: self._show(request, sheet))

    def _show(self, request: WatchRequest, sheet: Mosaic) -> None:
        if self._is_wanted():  # else the mode changed meanwhile
            self._plane.show(sheet, request)

    def _went_wrong(self, error: Exception) -> None:
        self._later(self._plane.freshness.failed)
        self._failed(error)
