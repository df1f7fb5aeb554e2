"""One browser: its state, what it asked for, and the pictures that are on their way to it."""

from __future__ import annotations

import logging
import queue
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import viser

from app.commands import Command, LookAt, SetMode, TogglePlay, UseConfig
from app.history import History
from app.interface import Interface
from app.jobs import Job, Progress
from app.label.scoring import LabelScore, find_reference, score_with_labels
from app.library import Library
from app.modes import FACTORIES, Mode
from app.panels.recording_info import RecordingInfo, gather_info
from app.plane import PicturePlane
from app.playback import Playhead
from app.scene.world import World
from app.sheet import Sheet
from app.state import MODES, ClientState, Configs
from app.views import Answer, TuneRequest, WatchRequest, answer_request
from app.watch.following import is_stereo
from app.watch.rallies import Rallies
from app.worker import LatestWins
from app.workspace import Workspace
from core.config import load_config, save_config
from core.detection import DetectorConfig
from core.errors import RallyscopeError, RecordingError
from core.evaluation import Score, score_recording
from core.rally.live import LiveRecording
from core.recordings import Recording

logger = logging.getLogger(__name__)
TIME_SHOWN_EVERY_S = 0.1
NOTE_SECONDS = 8.0
OWN_MODES = ("Watch", "Tune")
"""Modes whose pictures the session makes itself."""


class Session:
    """Owned by the loop: only `tick` changes anything; every other method may be called from any thread."""

    def __init__(
        self,
        client: viser.ClientHandle,
        library: Library,
        workspace: Workspace,
        pool: Executor,
        rallies: Rallies,
        wake: Callable[[], None],
        config: DetectorConfig,
    ) -> None:
        self.client = client
        self.library = library
        self.workspace = workspace
        self.pool = pool
        self.rallies = rallies
        self._wake = wake
        self._first_config = config
        self._inbox: queue.SimpleQueue[Command | Callable[[], None]] = queue.SimpleQueue()
        self._pictures = LatestWins(pool, answer_request, self._picture_done, self._failed)
        self._openings = LatestWins(pool, self._open, self._opened, self._failed)
        self._score: Job[Score | LabelScore] | None = None
        self._state: ClientState | None = None
        self._recording: Recording | None = None
        self._shown: ClientState | None = None
        self._requested: object = None
        self._time_shown_s = 0.0
        self._autoplay = False
        self._live_uuid = ""
        self.plane = PicturePlane(client, self._clicked)
        self.world = World(client)
        offered = tuple(name for name in MODES if name in OWN_MODES or name in FACTORIES)
        self._interface = Interface(client.gui, self.send, self._send_key, self, offered)
        with self._interface.modes_folder:
            self._modes: dict[str, Mode] = {name: FACTORIES[name](self) for name in offered if name in FACTORIES}
        self._active: str | None = None

    # What the browser asks for, from viser's event loop ---------------------------------------------------------

    def send(self, command: Command) -> None:
        """Enqueue a command."""
        self._enqueue(command)

    def later(self, act: Callable[[], None]) -> None:
        """Call `act` in the loop."""
        self._enqueue(act)

    def _send_key(self, command: Command) -> None:
        mode = None if self._state is None else self._modes.get(self._state.mode)
        if mode is None or not mode.takes_keys or isinstance(command, SetMode):
            self.send(command)

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
        self._enqueue(lambda: self.plane.frame(again=True))

    def _clicked(self, x: float, y: float) -> None:
        self._enqueue(lambda: self._apply_click(x, y))

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
                self.report(error)
        if self._state is None or self._recording is None:
            return
        if isinstance(self._recording, LiveRecording):
            self._grow(self._recording)
        self._state = replace(self._state, playhead=self._state.playhead.settle(wall_s))
        now_us = self._state.playhead.position_us(wall_s)
        mode = self._choose_mode(self._state)
        shown = self._state.without_growth()
        if shown != self._shown:
            self._shown = shown
            with self.client.atomic():
                self._interface.show(
                    self._state,
                    now_us,
                    uses_recording=mode is None or mode.uses_recording,
                    shows_events=mode is None or mode.middle == "events",
                )
        if wall_s - self._time_shown_s >= TIME_SHOWN_EVERY_S:
            self._time_shown_s = wall_s
            self._interface.show_time(self._state, now_us)
            self._show_score_progress()
        middle = "events" if mode is None else mode.middle
        self.plane.set_visible(middle != "world")  # first: from then on it does not move the camera
        self.world.show(middle == "world")
        if middle == "events":
            self._request_picture(self._state, self._recording, now_us)
        if mode is not None:
            mode.tick(self._state, now_us, wall_s)

    def _grow(self, recording: LiveRecording) -> None:
        assert self._state is not None
        if recording.uuid != self._live_uuid:  # another session of the simulation: another clock, maybe other cameras
            self._use_recording(self._state.recording, recording, None)
        head = self._state.playhead.grown(recording.start_us, recording.duration_us)
        self._state = replace(self._state, playhead=head)

    def _choose_mode(self, state: ClientState) -> Mode | None:
        """The mode that is chosen; tells the one before that it is over."""
        if state.mode != self._active:
            self._requested = None
            for name in (self._active, state.mode):
                if name in self._modes:
                    with self.client.atomic():
                        self._modes[name].show(name == state.mode)
            self._active = state.mode
        return self._modes.get(state.mode)

    @property
    def state(self) -> ClientState | None:
        """What the browser has chosen; None until its first recording is open."""
        return self._state

    @property
    def recording(self) -> Recording | None:
        """The one that is open."""
        return self._recording

    @property
    def sheet(self) -> Sheet:
        """What it shows now."""
        return self.plane.sheet

    @property
    def restless(self) -> bool:
        """Something moves by itself: the loop must not sleep long."""
        if self._state is None:
            return False
        mode = self._modes.get(self._state.mode)
        moving = mode is not None and mode.restless
        return moving or self._state.playhead.playing or self._score is not None

    def offer(self, recordings: tuple[str, ...], configs: tuple[str, ...]) -> None:
        """What the workspace holds now; called by the loop."""
        self._interface.show_recordings(recordings)
        self._interface.show_configs(configs)

    def close(self) -> None:
        """The browser is gone."""
        self._pictures.close()
        self._openings.close()
        for mode in self._modes.values():
            mode.close()
        if self._score is not None:
            self._score.cancel()

    # Pictures -----------------------------------------------------------------------------------------------------

    def _request_picture(self, state: ClientState, recording: Recording, now_us: int) -> None:
        view = state.tune
        if state.mode != "Tune":
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
        mode = self._modes.get(self._state.mode)
        if isinstance(request, TuneRequest) != (self._state.mode == "Tune") or (mode and mode.middle != "events"):
            return  # the mode changed meanwhile; the next answer is on its way
        self.plane.show(answer.sheet)
        if isinstance(request, TuneRequest):
            names = tuple(name for name, _ in request.configs)
            edited = names.index(request.view.slot)
            with self.client.atomic():
                self._interface.show_answer(answer, names, edited)

    # Recordings and configs ---------------------------------------------------------------------------------------

    def _open(self, name: str) -> tuple[Recording, RecordingInfo | None]:
        recording = self.library.open(name)
        if not recording.cameras:
            raise RecordingError("no cameras in this recording", where=name, remedy="choose another")
        return recording, None if isinstance(recording, LiveRecording) else gather_info(self.library, name)

    def _opened(self, name: str, answer: tuple[Recording, RecordingInfo | None]) -> None:
        self._enqueue(lambda: self._use_recording(name, *answer))

    def _use_recording(self, name: str, recording: Recording, info: RecordingInfo | None) -> None:
        self._recording = recording
        cameras = tuple(recording.cameras)
        playhead = Playhead(recording.duration_us, speed=0.25 if is_stereo(recording) else 0.05)
        if isinstance(recording, LiveRecording):
            self._live_uuid = recording.uuid
            playhead = replace(playhead, live=True, following=True, playing=True, speed=1.0)
        if self._state is None:
            configs = History(Configs(self._first_config, self._first_config))
            self._state = ClientState(name, cameras, cameras[0], playhead, configs)
        else:
            self._cancel_score()
            view = replace(self._state.tune, centre_px=None)
            self._state = replace(
                self._state, recording=name, cameras=cameras, camera=cameras[0], playhead=playhead, tune=view
            )
        if info is not None:
            self._interface.show_info(info)
        for mode in self._modes.values():
            mode.use_recording(recording)
        if self._autoplay and not playhead.live:
            self._autoplay = False
            self.send(TogglePlay())

    def _save_config(self, name: str) -> None:
        assert self._state is not None
        path = self.workspace.config_path(name)
        save_config(self._state.config, path)
        self._interface.show_configs(self.workspace.config_names())
        self.note("Config saved", f"{path.stem}: `rallyscope detect --config {path}` takes it", "green")

    def _load_config(self, name: str) -> None:
        if name in self.workspace.config_names():
            self.send(UseConfig(load_config(DetectorConfig, self.workspace.config_path(name))))

    # The score ----------------------------------------------------------------------------------------------------

    def _start_score(self) -> None:
        if self._state is None or self._recording is None or self._score is not None:
            return
        stream, config = self._recording.cameras[self._state.camera], self._state.config
        title = f"{self._state.recording}, {self._state.camera}, config {self._state.tune.slot}"
        folder, uuid = self.workspace.labels, self._recording.uuid

        def work(progress: Progress, cancelled: Callable[[], bool]) -> Score | LabelScore:
            reference = find_reference(folder, uuid, stream.name)  # what a person said, else what the simulation knows
            if reference is None:
                return score_recording(stream, config, progress=progress, cancelled=cancelled)
            return score_with_labels(folder, reference, stream, config, progress=progress, cancelled=cancelled)

        self._score = Job(
            work,
            lambda score: self._enqueue(lambda: self._score_done(title, score)),
            lambda error: self._enqueue(lambda: self._score_failed(error)),
        )
        self._interface.score.show_running(True)

    def _score_done(self, title: str, score: Score | LabelScore) -> None:
        self._score = None
        self._interface.score.show_score(title, score)
        self._interface.score.show_running(False)

    def _score_failed(self, error: Exception) -> None:
        self._score = None
        self._interface.score.show_running(False)
        self.report(error)

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

    def _apply_click(self, x: float, y: float) -> None:
        if self._state is None:
            return
        mode = self._modes.get(self._state.mode)
        if mode is not None:
            mode.clicked(x, y)
        elif (point := self.plane.sheet.sensor_point(x, y)) is not None and self._state.mode == "Tune":
            self.send(LookAt(point))

    def _failed(self, error: Exception) -> None:
        self._enqueue(lambda: self.report(error))

    def report(self, error: Exception) -> None:
        """Show what went wrong; in the loop."""
        self._shown = None  # the control that asked shows the old value again
        if isinstance(error, RallyscopeError):
            self.note("That does not work", str(error), "red")
        else:
            logger.error("unexpected error", exc_info=error)
            self.note("Something went wrong", "This is a bug; the terminal shows where.", "red")

    def note(self, title: str, body: str, color: str) -> None:
        """Show a message that goes away by itself."""
        self.client.add_notification(title, body, color=color, auto_close_seconds=NOTE_SECONDS)  # type: ignore[arg-type]
