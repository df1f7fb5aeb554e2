"""One browser: its state, what it asked for, and the pictures that are on their way to it."""

from __future__ import annotations

import logging
import queue
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import viser

from app.commands import Command, LookAt, TogglePlay, UseConfig
from app.history import History
from app.interface import Interface
from app.jobs import Job
from app.library import Library
from app.panels.recording_info import RecordingInfo, gather_info
from app.plane import PicturePlane
from app.playback import Playhead
from app.sheet import Sheet
from app.state import ClientState, Configs
from app.views import Answer, TuneRequest, WatchRequest, answer_request
from app.worker import LatestWins
from app.workspace import Workspace
from core.config import load_config, save_config
from core.detection import DetectorConfig
from core.errors import RallyscopeError, RecordingError
from core.evaluation import Score, score_recording
from core.recordings import Recording

logger = logging.getLogger(__name__)
TIME_SHOWN_EVERY_S = 0.1
NOTE_SECONDS = 8.0


class Session:
    """Owned by the loop: only `tick` changes anything; every other method may be called from any thread."""

    def __init__(
        self,
        client: viser.ClientHandle,
        library: Library,
        workspace: Workspace,
        pool: Executor,
        wake: Callable[[], None],
        config: DetectorConfig,
    ) -> None:
        self._client = client
        self._library = library
        self._workspace = workspace
        self._wake = wake
        self._first_config = config
        self._inbox: queue.SimpleQueue[Command | Callable[[], None]] = queue.SimpleQueue()
        self._pictures = LatestWins(pool, answer_request, self._picture_done, self._failed)
        self._openings = LatestWins(pool, self._open, self._opened, self._failed)
        self._score: Job[Score] | None = None
        self._state: ClientState | None = None
        self._recording: Recording | None = None
        self._shown: ClientState | None = None
        self._requested: object = None
        self._time_shown_s = 0.0
        self._autoplay = False
        self._plane = PicturePlane(client, self._clicked)
        self._interface = Interface(client.gui, self.send, self)

    # What the browser asks for, from viser's event loop ---------------------------------------------------------

    def send(self, command: Command) -> None:
        """Enqueue a command."""
        self._enqueue(command)

    def open_recording(self, name: str) -> None:
        """Open another recording of the library."""
        self._openings.submit(name)

    def play_when_open(self) -> None:
        """Play the next recording that is opened at once."""
        self._autoplay = True

    def save_config(self, name: str) -> None:
        """Save the config that is being edited under a name."""
        self._enqueue(lambda: self._save_config(name))

    def load_config(self, name: str) -> None:
        """Put a saved config into the slot that is being edited."""
        self._enqueue(lambda: self._load_config(name))

    def start_score(self) -> None:
        """Score the config that is being edited over the whole recording."""
        self._enqueue(self._start_score)

    def cancel_score(self) -> None:
        """Stop the score that runs."""
        self._enqueue(self._cancel_score)

    def reframe(self) -> None:
        """Put the picture back into the middle."""
        self._enqueue(lambda: self._plane.frame(again=True))

    def _clicked(self, x: float, y: float) -> None:
        point = self._plane.sheet.sensor_point(x, y)
        if point is not None and self._state is not None and self._state.mode == "Tune":
            self.send(LookAt(point))

    # The loop -----------------------------------------------------------------------------------------------------

    def tick(self, wall_s: float) -> None:
        """Apply what was asked for, then show what changed."""
        while not self._inbox.empty():
            item = self._inbox.get()
            try:
                if callable(item):
                    item()
                elif self._state is not None:
                    self._state = item.apply(self._state, wall_s)
            except RallyscopeError as error:
                self._report(error)
        if self._state is None or self._recording is None:
            return
        self._state = replace(self._state, playhead=self._state.playhead.settle(wall_s))
        now_us = self._state.playhead.position_us(wall_s)
        if self._state != self._shown:
            self._shown = self._state
            with self._client.atomic():
                self._interface.show(self._state, now_us)
        if wall_s - self._time_shown_s >= TIME_SHOWN_EVERY_S:
            self._time_shown_s = wall_s
            self._interface.show_time(self._state, now_us)
            self._show_score_progress()
        self._request_picture(self._state, self._recording, now_us)

    @property
    def state(self) -> ClientState | None:
        """What the browser has chosen; None until its first recording is open."""
        return self._state

    @property
    def sheet(self) -> Sheet:
        """What it shows now."""
        return self._plane.sheet

    @property
    def restless(self) -> bool:
        """Something moves by itself: the loop must not sleep long."""
        return self._state is not None and (self._state.playhead.playing or self._score is not None)

    def offer(self, recordings: tuple[str, ...], configs: tuple[str, ...]) -> None:
        """What the workspace holds now; called by the loop."""
        self._interface.show_recordings(recordings)
        self._interface.show_configs(configs)

    def close(self) -> None:
        """The browser is gone."""
        self._pictures.close()
        self._openings.close()
        if self._score is not None:
            self._score.cancel()

    # Pictures -----------------------------------------------------------------------------------------------------

    def _request_picture(self, state: ClientState, recording: Recording, now_us: int) -> None:
        view = state.tune
        if state.mode == "Watch":
            request = WatchRequest(recording, now_us, state.look, state.configs.present.a, view.show_truth)
            key: object = (recording.uuid, now_us, state.look, state.configs.present.a, view.show_truth)
        else:
            slots = ("A", "B") if view.compare else (view.slot,)
            configs = tuple((slot, state.configs.present.of(slot)) for slot in slots)
            request = TuneRequest(recording.cameras[state.camera], now_us, state.look, view, configs)
            key = (recording.uuid, state.camera, now_us, state.look, view, configs)
        if key != self._requested:
            self._requested = key
            self._pictures.submit(request)

    def _picture_done(self, request: WatchRequest | TuneRequest, answer: Answer) -> None:
        self._enqueue(lambda: self._show_answer(request, answer))

    def _show_answer(self, request: WatchRequest | TuneRequest, answer: Answer) -> None:
        assert self._state is not None
        if isinstance(request, TuneRequest) != (self._state.mode == "Tune"):
            return  # the mode changed meanwhile; the next answer is on its way
        self._plane.show(answer.sheet)
        if isinstance(request, TuneRequest):
            names = tuple(name for name, _ in request.configs)
            edited = names.index(request.view.slot)
            with self._client.atomic():
                self._interface.show_answer(answer, names, edited)

    # Recordings and configs ---------------------------------------------------------------------------------------

    def _open(self, name: str) -> tuple[Recording, RecordingInfo]:
        recording = self._library.open(name)
        if not recording.cameras:
            raise RecordingError("no cameras in this recording", where=name, remedy="choose another")
        return recording, gather_info(self._library, name)

    def _opened(self, name: str, answer: tuple[Recording, RecordingInfo]) -> None:
        self._enqueue(lambda: self._use_recording(name, *answer))

    def _use_recording(self, name: str, recording: Recording, info: RecordingInfo) -> None:
        self._recording = recording
        cameras = tuple(recording.cameras)
        playhead = Playhead(recording.duration_us)
        if self._state is None:
            configs = History(Configs(self._first_config, self._first_config))
            self._state = ClientState(name, cameras, cameras[0], playhead, configs)
        else:
            self._cancel_score()
            view = replace(self._state.tune, centre_px=None)
            self._state = replace(
                self._state, recording=name, cameras=cameras, camera=cameras[0], playhead=playhead, tune=view
            )
        self._interface.show_info(info)
        if self._autoplay:
            self._autoplay = False
            self.send(TogglePlay())

    def _save_config(self, name: str) -> None:
        assert self._state is not None
        path = self._workspace.config_path(name)
        save_config(self._state.config, path)
        self._interface.show_configs(self._workspace.config_names())
        self._note("Config saved", f"{path.stem}: `rallyscope detect --config {path}` takes it", "green")

    def _load_config(self, name: str) -> None:
        if name in self._workspace.config_names():
            self.send(UseConfig(load_config(DetectorConfig, self._workspace.config_path(name))))

    # The score ----------------------------------------------------------------------------------------------------

    def _start_score(self) -> None:
        if self._state is None or self._recording is None or self._score is not None:
            return
        stream, config = self._recording.cameras[self._state.camera], self._state.config
        title = f"{self._state.recording}, {self._state.camera}, config {self._state.tune.slot}"
        self._score = Job(
            lambda progress, cancelled: score_recording(stream, config, progress=progress, cancelled=cancelled),
            lambda score: self._enqueue(lambda: self._score_done(title, score)),
            lambda error: self._enqueue(lambda: self._score_failed(error)),
        )
        self._interface.score.show_running(True)

    def _score_done(self, title: str, score: Score) -> None:
        self._score = None
        self._interface.score.show_score(title, score)
        self._interface.score.show_running(False)

    def _score_failed(self, error: Exception) -> None:
        self._score = None
        self._interface.score.show_running(False)
        self._report(error)

    def _cancel_score(self) -> None:
        if self._score is not None:
            self._score.cancel()
            self._score = None
            self._interface.score.show_running(False)

    def _show_score_progress(self) -> None:
        if self._score is not None:
            self._interface.score.show_progress(self._score.share)

    # Messages -----------------------------------------------------------------------------------------------------

    def _enqueue(self, item: Command | Callable[[], None]) -> None:
        self._inbox.put(item)
        self._wake()

    def _failed(self, error: Exception) -> None:
        self._enqueue(lambda: self._report(error))

    def _report(self, error: Exception) -> None:
        self._shown = None  # the control that asked shows the old value again
        if isinstance(error, RallyscopeError):
            self._note("That does not work", str(error), "red")
        else:
            logger.error("unexpected error", exc_info=error)
            self._note("Something went wrong", "This is a bug; the terminal shows where.", "red")

    def _note(self, title: str, body: str, color: str) -> None:
        self._client.add_notification(title, body, color=color, auto_close_seconds=NOTE_SECONDS)  # type: ignore[arg-type]
