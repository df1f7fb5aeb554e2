"""Session and page: the link in the address, and the settings stored for the browser."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

from app.client_session.view_link import Values, commands_of, link_of, place_of, values_of
from app.state.browser_memory import BrowserMemory, Remembered
from app.state.client_state import MODES, ClientState, Configs, History, Playhead, TuneView
from app.state.commands import Command, SetMode
from app.web.pages import Message, PageConnection, Pages
from app.web.uploads import Purpose
from core.detection import DetectorConfig
from core.detection.methods import DEFAULT_METHOD
from core.detection.saved import SavedDetector

FEW_EVERY_S: Final = 0.2
LEAST_SHARE: Final = 1 / 3
"""Pictures become no rarer below this share of the asked pace."""


class FrameThrottle:
    """Limits the frame rate of one browser. Called by its loop, except `request_frame`."""

    def __init__(self) -> None:
        self._by_software = False
        self._share = 1.0
        self._hurried = True
        self._shown_s = float("-inf")

    def hear(self, message: Message) -> None:
        """Read the page's report of its renderer."""
        self._by_software = message.get("software") is True

    def hear_pace(self, share: float) -> None:
        """Take the share of the asked pace that the live rally keeps, 0 to 1."""
        self._share = share

    @property
    def apart_s(self) -> float:
        """Time between frames of a throttled page: as many for each second of the rally, however slowly that passes.

        A simulation that cannot keep up beside a page that this machine draws gets the time that fewer pictures leave.
        """
        return FEW_EVERY_S / max(self._share, LEAST_SHARE)

    @property
    def by_software(self) -> bool:
        """Whether the page is rendered on the CPU."""
        return self._by_software

    def request_frame(self) -> None:
        """Draw the next frame at once, for a user's action; called from any thread."""
        self._hurried = True

    def throttles(self, state: ClientState | None) -> bool:
        """Whether this is a live rally on a page that is rendered on the CPU."""
        return self._by_software and state is not None and state.playhead.live and state.playhead.playing

    def is_due(self, state: ClientState | None, wall_s: float) -> bool:
        """Whether the browser gets its next frame now."""
        if self.throttles(state) and wall_s - self._shown_s < self.apart_s and not self._hurried:
            return False
        self._hurried, self._shown_s = False, wall_s
        return True


LINK_EVERY_S: Final = 0.3
LINK_PLAYING_S: Final = 1.0
KEEP_EVERY_S: Final = 1.0
FIRST_ZOOM: Final = 6.0
MISSING: Final = "Its recording is not in this workspace."
Listener = Callable[[Message], None]


def opened_view(view: TuneView, *, has_ball: bool) -> TuneView:
    """Tune's view after another recording was opened: the whole sensor where no ball is known to zoom on.

    The zoom of the recording before would show the middle of the sensor, which is often dark.
    """
    return replace(view, centre_px=None, picked=None, frames="", zoom=view.zoom if has_ball else 1.0)


class PageSession(Protocol):
    """The session's interface for its page."""

    def later(self, act: Callable[[], None]) -> None: ...
    def apply(self, command: Command) -> None: ...
    def open_recording(self, name: str) -> None: ...
    def note(self, title: str, body: str, color: str) -> None: ...

    @property
    def state(self) -> ClientState | None: ...


class SessionPage:
    """Owned by the session: every method but `listen` and `send` is called by its loop."""

    def __init__(
        self, visit: PageConnection, pages: Pages, memory: BrowserMemory, pool: Executor, session: PageSession
    ) -> None:
        self._visit = visit
        self._pages = pages
        self._memory = memory
        self._pool = pool
        self._session = session
        self._link: Values = values_of(visit.link)
        self.is_new = bool(visit.browser) and not visit.link and not memory.knows(visit.browser)
        """Whether this browser is new and came without a link."""
        self._shown_link = ""
        self._shown_keys: Message = {}
        self._linked_s = self._kept_s = 0.0
        self._kept: Remembered | None = None
        self._closed = False
        self._listeners: dict[str, Listener] = {"open_link": self._open_link, "go_to_link": self._go_to_link}
        if visit.page:
            pages.open(visit.page, self._hear)

    def listen(self, kind: str, listener: Listener) -> None:
        """Call `listener` in the loop with every message of this kind. Nothing in a message is trusted."""
        self._listeners[kind] = listener

    def receive(self, take: Callable[[Path], None], purpose: Purpose = "recording") -> None:
        """Pass files uploaded for a purpose to `take`, in the server's event loop; `take` owns them."""
        if self._visit.page:
            self._pages.uploads.open(self._visit.page, take, purpose)

    def send(self, kind: str, values: Message) -> None:
        """Send a message to the page; only the latest of each kind is kept."""
        if self._visit.page:
            self._pages.send(self._visit.page, kind, values)

    def say(self, text: str) -> None:
        """Show one line that goes away by itself."""
        self.send("line", {"text": text, "number": time.time_ns() // 1_000_000})

    def show_keys(self, mode: str, *, moves_camera: bool) -> None:
        """Let the page know its mode, and whether W A S D Q E move a camera there, for keys that do nothing."""
        keys: Message = {"mode": mode, "moves_camera": moves_camera}
        if keys != self._shown_keys:
            self._shown_keys = keys
            self.send("keys", keys)

    @property
    def seen(self) -> frozenset[str]:
        """Names of the hints that this browser has already seen."""
        return self._memory.seen(self._visit.browser)

    @property
    def has_link(self) -> bool:
        """Whether it came with a link."""
        return bool(self._visit.link)

    def note_seen(self, what: str) -> None:
        """Store that it has seen a hint."""
        self._pool.submit(self._memory.note_seen, self._visit.browser, what)

    def first_recording(self, usual: str, offered: tuple[str, ...]) -> str:
        """First recording to open: the link's, or the default if that is missing."""
        name = self._link.get("recording", usual)
        if name == usual or name in offered:
            return name
        self._link = {}
        self._session.later(lambda: self._session.note("The link cannot be opened", MISSING, "yellow"))
        return usual

    def first_state(
        self,
        name: str,
        cameras: tuple[str, ...],
        playhead: Playhead,
        detector: SavedDetector | None,
        *,
        at_ball: bool = False,
    ) -> ClientState:
        """What the browser begins with: as it was left, and the detector of the command line, if any, as its last step.

        Where it opens at a ball Tune is zoomed on that, unless a link says how it was looked at.
        """
        tune = TuneView(zoom=FIRST_ZOOM) if at_ball and not self._link else TuneView()
        fresh = History(Configs(DetectorConfig(), DetectorConfig()))
        known = self._memory.recall(self._visit.browser)
        left = known or Remembered(fresh, method=DEFAULT_METHOD)
        tune = replace(tune, method=left.method if detector is None else detector.method)
        state = ClientState(name, cameras, cameras[0], playhead, left.configs, dict(left.own_configs), tune=tune)
        if detector is None:
            return state
        given = Configs(detector.config, detector.config)
        if known is None:
            return state.with_history(History(given))
        return state.with_history(state.history.change(given, topic=None, wall_s=time.monotonic()))

    def follow_link(self, state: ClientState) -> ClientState:
        """Apply a link once its recording is open."""
        if self._link.get("recording", state.recording) != state.recording:
            return state
        link, self._link = self._link, {}
        for command in commands_of(link, state):
            state = command.apply(state, time.monotonic())
        return state

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Update the link in the address, and store the settings."""
        every_s = LINK_PLAYING_S if state.playhead.playing else LINK_EVERY_S
        if self._visit.page and wall_s - self._linked_s >= every_s and not self._link:
            self._linked_s = wall_s
            link = link_of(state, now_us)
            if link != self._shown_link:
                self._shown_link = link
                self.send("link", {"link": link})
        if wall_s - self._kept_s >= KEEP_EVERY_S:
            self._kept_s = wall_s
            self._keep(state, lambda browser, remembered: self._pool.submit(self._memory.keep, browser, remembered))

    def close(self, state: ClientState | None) -> None:
        """The browser has disconnected; its last settings are stored before this returns."""
        if self._closed:
            return
        self._closed = True
        if state is not None:
            self._keep(state, self._memory.keep)
        if self._visit.page:
            self._pages.close(self._visit.page, self._hear)

    def _keep(self, state: ClientState, keep: Callable[[str, Remembered], object]) -> None:
        """Store the settings if they have changed."""
        remembered = Remembered(state.configs, state.own_configs, state.tune.method)
        known, self._kept = self._kept, remembered
        if known is not None and known != remembered and self._visit.browser:
            keep(self._visit.browser, remembered)

    def _hear(self, message: Message) -> None:
        self._session.later(lambda: self._deliver(message))

    def _deliver(self, message: Message) -> None:
        # Looked up only now: a page's first messages come while its session is still being made, and adds listeners.
        if (listener := self._listeners.get(str(message["type"]))) is not None:
            listener(message)

    def _go_to_link(self, message: Message) -> None:
        """Back or Forward: to the mode of a link, and to its recording where another is open. Settings stay."""
        values, state = place_of(values_of(str(message.get("link", "")))), self._session.state
        if state is not None and values.get("recording", state.recording) != state.recording:
            self._link = values
            self._session.open_recording(values["recording"])
        elif values["mode"] in MODES:
            self._session.apply(SetMode(values["mode"]))  # type: ignore[arg-type]

    def _open_link(self, message: Message) -> None:
        self._link = values_of(str(message.get("link", "")))
        name = self._link.get("recording")
        if name is not None:
            self._session.open_recording(name)
