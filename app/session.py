"""One browser's session: its state, queued commands, and requested pictures."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Final

import viser

from app.background.jobs import LatestWins
from app.client_session import SessionPage
from app.client_session.event_pictures import EventPictures
from app.client_session.file_opening import FileOpening
from app.client_session.lesson_card import Lessons
from app.client_session.lesson_checks import LessonFacts, gather_facts
from app.client_session.opening_moment import OpeningMoment
from app.client_session.session_page import FrameThrottle, opened_view
from app.client_session.tour import Tour
from app.control_panel import ControlPanel
from app.formatting import notice_of
from app.modes.export.mode import ExportMode
from app.modes.label.mode import LabelMode
from app.modes.mode import Middle, Mode, ModeFactory
from app.modes.services import Services
from app.modes.train.mode import TrainMode
from app.modes.tune.mode import TuneMode
from app.modes.watch.commands import EnlargePicture
from app.modes.watch.mode import WatchMode
from app.panels.keys import idle_key_text, key_has_effect
from app.panels.recording_info import RecordingInfo, gather_info
from app.panels.time_bar import ContactMark, Runs, TimeBar, opening_us, tracks_of
from app.scene.space_time import SpaceTimeScene
from app.scene.world import World
from app.shared.live_rally import LiveRally
from app.shared.source_notifications import SourceNotifications
from app.startup.example_rally import AFTER_S, ExampleRally
from app.startup.panel import AwaitedRecording, PreparationPanel
from app.startup.startup import Preparation
from app.state.client_state import MODES, ClientState, ModeName, Playhead
from app.state.commands import Command, SetMode, TogglePlay
from app.state.swept_cells import TableClicks
from app.views.frame_picture import titled_frames
from app.views.image_view import ImageView
from app.views.mosaic import Mosaic
from app.web.pages import Message, PageConnection, Pages
from app.web.uploads import Purpose
from core.detection.saved import SavedDetector
from core.errors import RallyscopeError, RecordingError
from core.extras import missing_package
from core.history.following import is_stereo
from core.live.ring_recording import RingRecording
from core.recordings import Recording, knows_ball

logger = logging.getLogger(__name__)
NOTE_SECONDS = 8.0
STILLS_EVERY_S = 1.0
"""Interval of the example's pictures on a page that is rendered on the CPU, which is busy compiling."""
SLOW_MOTION = ("Slow motion", "A bounce at 1/20 speed; live again after the return (key End: now)")
FACTORIES: Final[dict[ModeName, ModeFactory]] = {
    "Watch": WatchMode,
    "Tune": TuneMode,
    "Label": LabelMode,
    "Train": TrainMode,
    "Export": ExportMode,
}
"""Factory of each mode, by name."""


class Session:
    """Owned by the loop: only `tick` changes anything; every other method may be called from any thread."""

    def __init__(
        self,
        client: viser.ClientHandle,
        services: Services,
        pool: Executor,
        wake: Callable[[], None],
        detector: SavedDetector | None,
        preparation: Preparation | None = None,
        *,
        visit: PageConnection,
        pages: Pages,
    ) -> None:
        self.client = client
        self.services = services
        self.pool = pool
        self._wake = wake
        self._first_detector = detector
        self._awaited = AwaitedRecording(services.library, preparation, lambda: PreparationPanel(client.gui))
        self._pace = FrameThrottle()
        self._page_apart_s = 0.0
        self._inbox: queue.SimpleQueue[Command | Callable[[], None]] = queue.SimpleQueue()
        self._openings = LatestWins(pool, self._open, self._opened, self._failed)
        self._state: ClientState | None = None
        self._recording: Recording | None = None
        self.knows_ball = False
        self._shown: tuple[ClientState, Middle, bool] | None = None
        self._autoplay = False
        self._is_complete = False
        """Whether the page was sent a view that is complete."""
        self._is_visible = True
        """Whether the page can be seen: its tab is in front, and its window is not minimised."""
        self._live_uuid = ""
        self._source_news = SourceNotifications()
        self.page = SessionPage(visit, pages, services.browsers, pool, self)
        self.plane = ImageView(client, self._clicked)
        self._pictures = EventPictures(pool, self.plane, self.later, self._failed, self._shows_events)
        self.world = World(client, lambda: self.plane.aspect)
        self.space = SpaceTimeScene(client)
        self._preparation = preparation
        is_first = preparation is not None and preparation.is_first
        self._example = ExampleRally(self.world.draw, after_s=0.0 if is_first else AFTER_S)
        self._interface = ControlPanel(client.gui, self.send, self._send_key, self)
        with self._interface.modes_folder:
            self._modes: dict[ModeName, Mode] = {name: FACTORIES[name](self) for name in MODES}
        self._active: ModeName | None = None
        self._files = FileOpening(self.page, services, pool, self)
        self._tour = Tour(self.page)
        self._lessons = Lessons(self.page, self, self._lesson_facts)
        self.page.listen("drawing", self._pace.hear)
        self._opening = OpeningMoment(lambda: self.note(*SLOW_MOTION, "blue")) if self.page.is_new else None
        self._bar = TimeBar(self.page, self.apply)
        self.page.listen("size", self.plane.window_resized)
        self.page.listen("picture", self.plane.picture_resized)
        self.page.listen("lower", self.plane.panel_resized)
        self.page.listen("enlarge", lambda message: self.apply(EnlargePicture(message.get("camera"))))
        self.page.listen("hand", lambda _: self.world.touched())
        self.page.listen("visible", self._see_page)
        self.plane.tell = self.page.send

    # Requests from the browser, in viser's event loop ---------------------------------------------------------

    def send(self, command: Command) -> None:
        """Enqueue a command."""
        self._pace.request_frame()
        self._enqueue(command)

    def apply(self, command: Command) -> None:
        """Apply a command at once, before what is enqueued; in the loop."""
        if self._state is not None:
            self._state = command.apply(self._state, time.monotonic())
            self._pace.request_frame()
            self._wake()

    def later(self, act: Callable[[], None]) -> None:
        """Run `act` in the loop."""
        self._enqueue(act)

    def _send_key(self, command: Command) -> None:
        self._pace.request_frame()
        self._enqueue(lambda: self._apply_key(command))

    def _apply_key(self, command: Command) -> None:
        """Apply a key's command; say so if it changes nothing. A mode with its own keys takes only changes of mode."""
        before = self._state
        if before is None:
            return
        mode = self._modes[before.mode]
        if mode.takes_keys and not isinstance(command, SetMode):
            return
        after = command.apply(before, time.monotonic())
        if key_has_effect(command, before, after, uses_recording=mode.uses_recording):
            self._state = after
        else:
            self.page.say(idle_key_text(command, before.mode))

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None:
        """Call `listener` in the loop with every message of this kind of the page."""
        self.page.listen(kind, listener)

    def receive(self, take: Callable[[Path], None], purpose: Purpose) -> None:
        """Pass files that the page sends for a purpose to `take`, in the server's event loop; `take` owns them."""
        self.page.receive(take, purpose)

    def send_to_page(self, kind: str, values: Message) -> None:
        """Send a message to the scripts of the page; only the latest of each kind is kept."""
        self.page.send(kind, values)

    def say(self, text: str) -> None:
        """Show one line on the page that goes away by itself."""
        self.page.say(text)

    def open_recording(self, name: str) -> None:
        """Open another recording of the library."""
        self._enqueue(lambda: self._choose(name))

    def await_recording(self, name: str) -> None:
        """Open a recording as soon as it exists, unless another is chosen before."""
        self._enqueue(lambda: self._awaited.expect(name))

    def show_files(self) -> None:
        """Show the page's file dialog."""
        self._enqueue(self._files.show_dialog)

    def show_tour(self) -> None:
        """Show the tour of this mode."""
        self._enqueue(self._tour.show)

    def show_lessons(self) -> None:
        """Show the lessons."""
        self._enqueue(self._lessons.show)

    def _lesson_facts(self) -> LessonFacts:
        assert self._state is not None
        now_us = self._state.playhead.position_us(time.monotonic())
        return gather_facts(self._state, now_us, self._bar.tracks.moments, self._modes)

    def play_when_open(self) -> None:
        """Play the next recording that is opened at once."""
        self._autoplay = True

    def reframe(self) -> None:
        """Reset the view of the picture."""
        self._enqueue(lambda: self.plane.frame(again=True))

    def _see_page(self, message: Message) -> None:
        self._is_visible = message.get("visible") is not False

    def _clicked(self, x: float, y: float) -> None:
        self._enqueue(lambda: self._apply_click(x, y))

    # The loop -----------------------------------------------------------------------------------------------------

    def tick(self, wall_s: float) -> None:
        """Apply queued commands, then show what changed; a slow page is throttled."""
        if not self._pace.is_due(self._state, wall_s):
            return
        while not self._inbox.empty():
            item = self._inbox.get()
            try:
                if callable(item):
                    item()
                elif self._state is not None:
                    self._state = item.apply(self._state, wall_s)
            except RallyscopeError as error:
                self.report(error)
        self._files.tick()
        if (arrived := self._awaited.tick()) is not None:
            self._openings.submit(arrived)
        if self._state is None or self._recording is None:
            if self._awaited.waiting:
                self._show_before_the_first(wall_s)
            return
        if isinstance(self._recording, RingRecording):
            self._grow(self._recording, wall_s)
            live = self.services.rallies.live
            for news in self._source_news.of(live, wall_s):
                self.note(*news)
            self._keep_frames_apart(live)
        self._state = replace(self._state, playhead=self._state.playhead.settle(wall_s))
        if self._opening is not None:
            self._open_slowly(self._opening, self._recording, wall_s)
        now_us = self._state.playhead.position_us(wall_s)
        mode = self._choose_mode(self._state)
        shown = (self._state.without_growth(), mode.middle, self.knows_ball)
        if shown != self._shown:
            self._shown = shown
            with self.client.atomic():
                self._interface.show(
                    self._state,
                    uses_recording=mode.uses_recording,
                    shows_events=mode.middle == "events",
                    knows_ball=self.knows_ball,
                )
        uses_time = mode.uses_recording
        self._bar.show(self._state, now_us, wall_s, visible=uses_time, keys=uses_time and not mode.takes_keys)
        self.page.tick(self._state, now_us, wall_s)
        self.page.show_keys(self._state.mode, moves_camera=mode.middle in ("world", "space"))
        self._lessons.tick(wall_s)
        self._tour.tick(self._state.mode, waits=self._lessons.is_shown)
        middle = mode.middle
        self.plane.set_visible(middle not in ("world", "space"))  # first: from then on it does not move the camera
        self.world.show(middle == "world")
        self.space.set_visible(middle == "space")
        self.space.stand(self.plane.aspect, self.plane.panel_share)
        if middle == "events":
            self._pictures.ask(self._state, self._recording, now_us, wall_s)
        elif middle == "sheet":
            self._pictures.forget()  # a mode's own pictures replace what was shown
        mode.tick(self._state, now_us, wall_s)
        self.plane.show_staleness(wall_s, moving=self._state.playhead.playing)
        self.world.billboard_wxyz()
        self._reveal()

    def _keep_frames_apart(self, live: LiveRally | None) -> None:
        """Tell the page how far apart it draws, if it is throttled and that has changed."""
        if live is not None and live.source.state is not None:
            self._pace.hear_pace(live.source.state.kept_share)
        if self._pace.by_software and self._pace.apart_s != self._page_apart_s:
            self._page_apart_s = self._pace.apart_s
            self.page.send("apart", {"seconds": self._page_apart_s})

    def _show_before_the_first(self, wall_s: float) -> None:
        """An empty table, and a recorded rally over it while something is compiled."""
        self.plane.set_visible(False)
        self.world.show(True)
        if self._awaited.is_preparing:
            self._example.tick(wall_s, STILLS_EVERY_S if self._pace.by_software else 0.0)
            if self._preparation is not None and self._example.is_shown:
                self._preparation.picture_is_shown.set()
        self.world.billboard_wxyz()
        self._reveal()

    def _reveal(self) -> None:
        """Let the page show itself: until then it would show the panels of all modes as they arrive."""
        if not self._is_complete:
            self._is_complete = True
            self.client.flush()
            self.page.send("ready", {})

    def _open_slowly(self, opening: OpeningMoment, recording: Recording, wall_s: float) -> None:
        """Show the first bounce in slow motion to a new browser."""
        assert self._state is not None
        rally = self.services.rallies.of(recording) if isinstance(recording, RingRecording) else None
        self._state = opening.follow(self._state, None if rally is None else rally.history, wall_s)
        if opening.over:
            self._opening = None

    def _choose(self, name: str) -> None:
        self._awaited.expect(None)
        if not self._files.open_listed(name):
            self._openings.submit(name)

    def _grow(self, recording: RingRecording, wall_s: float) -> None:
        assert self._state is not None
        if recording.uuid != self._live_uuid:  # a new session of the simulation has a new clock and maybe other cameras
            self._use_recording(self._state.recording, recording, None)
        head = self._state.playhead.grown(recording.start_us, recording.duration_us)
        self._state = replace(self._state, playhead=head)
        self.knows_ball = self.knows_ball or knows_ball(recording)
        self._bar.grow(recording, wall_s)

    def _choose_mode(self, state: ClientState) -> Mode:
        """The chosen mode; the previous one is hidden."""
        if state.mode != self._active:
            self._pictures.forget()
            self.plane.freshness.forget()
            for name in (self._active, state.mode):
                if name is not None:
                    with self.client.atomic():
                        self._modes[name].show(name == state.mode)
            self._active = state.mode
        return self._modes[state.mode]

    def _shows_events(self) -> bool:
        return self._state is not None and self._modes[self._state.mode].middle == "events"

    @property
    def state(self) -> ClientState | None:
        """State of the browser; None until its first recording is open."""
        return self._state

    @property
    def is_throttled(self) -> bool:
        """Whether updates of moving things are throttled for this page."""
        return self._pace.throttles(self._state)

    @property
    def recording(self) -> Recording | None:
        """The open recording."""
        return self._recording

    @property
    def sheet(self) -> Mosaic:
        """The shown mosaic."""
        return self.plane.sheet

    def show_runs(self, name: str, runs: Runs) -> None:
        """Show a line of this name in the time bar until another recording is opened."""
        self._bar.show_runs(name, runs)

    def show_contacts(self, contacts: tuple[ContactMark, ...]) -> None:
        """Show these bounces, hits and net touches in the time bar until another recording is opened."""
        self._bar.show_contacts(contacts)

    @property
    def needs_tick(self) -> bool:
        """Whether something moves by itself, so that the loop must not sleep long."""
        if not self._is_visible:
            return False
        if self._state is None:
            return self._awaited.is_preparing and not self._pace.by_software
        waiting = self.plane.freshness.is_waiting  # an outdated picture is marked in time
        return self._modes[self._state.mode].needs_tick or self._state.playhead.playing or waiting

    @property
    def watches_live(self) -> bool:
        """Whether this browser shows the live rally, or will when its page is complete."""
        if self._state is None or self._recording is None:
            return True
        shows_it = isinstance(self._recording, RingRecording) and self._modes[self._state.mode].uses_recording
        return shows_it and self._is_visible

    def offer(self, recordings: tuple[str, ...]) -> None:
        """Update the list of recordings; called by the loop."""
        self._interface.show_recordings(recordings)

    def close(self) -> None:
        """The browser has disconnected."""
        self.page.close(self._state)
        self._files.close()
        self._pictures.close()
        self._openings.close()
        for mode in self._modes.values():
            mode.close()

    # Recordings ---------------------------------------------------------------------------------------------------

    def _open(self, name: str) -> tuple[Recording, RecordingInfo | None]:
        recording = self.services.library.open(name)
        if not recording.cameras:
            raise RecordingError("no cameras in this recording", where=name, remedy="choose another")
        return recording, None if isinstance(recording, RingRecording) else gather_info(self.services.library, name)

    def _opened(self, name: str, answer: tuple[Recording, RecordingInfo | None]) -> None:
        self._enqueue(lambda: self._use_opened(name, answer))

    def _use_opened(self, name: str, answer: tuple[Recording, RecordingInfo | None]) -> None:
        self.offer(self.services.library.names())  # it may be new
        self._use_recording(self.services.library.settled_name(name), *answer)

    def _use_recording(self, name: str, recording: Recording, info: RecordingInfo | None) -> None:
        self._recording, self.knows_ball = recording, knows_ball(recording)
        cameras = tuple(recording.cameras)
        opens_us = opening_us(recording)
        # A flight takes half a second: slowed down so that it can be followed.
        playhead = Playhead(recording.duration_us, anchor_us=opens_us, speed=0.25 if is_stereo(recording) else 0.05)
        if isinstance(recording, RingRecording):
            self._live_uuid = recording.uuid
            playhead = replace(playhead, live=True, following=True, playing=True, speed=1.0)
        if self._state is None:
            self._state = self.page.first_state(name, cameras, playhead, self._first_detector, at_ball=opens_us > 0)
        else:
            views = {
                "tune": opened_view(self._state.tune, has_ball=self.knows_ball or playhead.live),
                "watch": replace(self._state.watch, large="", table=TableClicks()),
            }
            self._state = replace(
                self._state,
                recording=name,
                cameras=cameras,
                camera=cameras[0],
                playhead=playhead,
                **views,
                marks_us=(),
            )
        self._files.show_recording(name)
        if info is not None:
            self._interface.show_info(info)
        self._bar.show_tracks(tracks_of(recording, info))
        for mode in self._modes.values():
            mode.use_recording(recording)
        rally = self.services.rallies.of(recording, self._state.watch.prediction)
        followed = () if rally is None else tuple(rally.frames)
        self._state = replace(self._state, frame_cameras=followed, titled_frames=tuple(titled_frames(recording)))
        # Last: what a link says counts more than what a recording opens with.
        self._state = self.page.follow_link(self._state)
        if self._autoplay and not playhead.live:
            self._autoplay = False
            self.send(TogglePlay())

    # Messages -----------------------------------------------------------------------------------------------------

    def _enqueue(self, item: Command | Callable[[], None]) -> None:
        self._inbox.put(item)
        self._wake()

    def _apply_click(self, x: float, y: float) -> None:
        if self._state is not None:
            self._modes[self._state.mode].clicked(x, y)

    def _failed(self, error: Exception) -> None:
        self._enqueue(lambda: self.report(error))

    def report(self, error: Exception) -> None:
        """Show an error; called in the loop."""
        self._shown = None  # reset the control to the old value
        error = missing_package(error) or error
        if isinstance(error, RallyscopeError):
            self.note(*notice_of(error), "red")
        else:
            logger.error("unexpected error", exc_info=error)
            self.note("Something went wrong", "This is a bug; the terminal shows where.", "red")

    def note(self, title: str, body: str, color: str) -> None:
        """Show a message that goes away by itself."""
        self.client.add_notification(title, body, color=color, auto_close_seconds=NOTE_SECONDS)  # type: ignore[arg-type]
