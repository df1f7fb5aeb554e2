"""What a mode of the app is, what a browser's session lends to it, and what several modes do alike."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Final, Literal, Protocol

import viser

from app import theme
from app.export.exporter import ExportState
from app.formatting import html_text, percent
from app.modes.services import Services
from app.panels.time_bar import ContactMark, Runs
from app.scene.space_time import SpaceTimeScene
from app.scene.world import World
from app.state.client_state import ClientState
from app.state.commands import Command
from app.views.image_view import ImageView
from app.web.pages import Message
from app.web.uploads import Purpose
from core.errors import CommandError, RallyscopeError
from core.recordings import Recording

Middle = Literal["events", "sheet", "world", "space"]


class ModeHost(Protocol):
    """The session of one browser, as a mode sees it. Callbacks of controls must do their work in `later`."""

    @property
    def client(self) -> viser.ClientHandle: ...
    @property
    def services(self) -> Services:
        """What all browsers share."""
        ...

    @property
    def pool(self) -> Executor: ...
    @property
    def plane(self) -> ImageView:
        """Flat pictures in the middle of the window; visible while `middle` is "events" or "sheet"."""
        ...

    @property
    def world(self) -> World:
        """The 3D scene in the middle of the window; visible while `middle` is "world"."""
        ...

    @property
    def space(self) -> SpaceTimeScene:
        """Events in space and time in the middle of the window; visible while `middle` is "space"."""
        ...

    @property
    def state(self) -> ClientState | None: ...
    @property
    def recording(self) -> Recording | None:
        """The one that is open."""
        ...

    @property
    def knows_ball(self) -> bool:
        """Whether that says where the ball truly is."""
        ...

    @property
    def is_throttled(self) -> bool:
        """Whether the page is to be told less often of what moves by itself: it is drawn at the cost of the rally."""
        ...

    def send(self, command: Command) -> None:
        """Enqueue a change of the state; from any thread."""
        ...

    def apply(self, command: Command) -> None:
        """Change the state at once, before what is enqueued; in the loop."""
        ...

    def open_recording(self, name: str) -> None:
        """Open another recording of the library; from any thread."""
        ...

    def later(self, act: Callable[[], None]) -> None:
        """Call `act` in the loop, in order; from any thread. Its RallyscopeErrors are shown to the person."""
        ...

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None:
        """Call `listener` in the loop with every message of this kind of the page. Nothing in it is trusted."""
        ...

    def receive(self, take: Callable[[Path], None], purpose: Purpose) -> None:
        """Pass files that the page sends for a purpose to `take`, in the server's event loop.

        Each lies alone in a folder; `take` owns both. Nothing in them is trusted.
        """
        ...

    def send_to_page(self, kind: str, values: Message) -> None:
        """Send a message to the scripts of the page; only the latest of each kind is kept."""
        ...

    def say(self, text: str) -> None:
        """Show one line on the page that goes away by itself; in the loop."""
        ...

    def report(self, error: Exception) -> None:
        """Show what went wrong; in the loop."""
        ...

    def note(self, title: str, body: str, color: str) -> None:
        """Show a message that goes away by itself."""
        ...

    def show_runs(self, name: str, runs: Runs) -> None:
        """Show a line of this name in the time bar until another recording is opened; in the loop."""
        ...

    def show_contacts(self, contacts: tuple[ContactMark, ...]) -> None:
        """Show these bounces, hits and net touches in the time bar until another recording is opened; in the loop."""
        ...


class Mode(Protocol):
    """One mode in one browser. It is made once, with its controls hidden; all methods are called by the loop."""

    uses_recording: bool
    """Whether the list of recordings, the time controls and the look of the pictures are shown."""
    takes_keys: bool
    """Whether the keys of Watch and Tune do nothing here, but for those that choose a mode: it has its own."""

    @property
    def middle(self) -> Middle:
        """What the middle of the window shows: the session's event pictures, a sheet of the mode's own, the rally in
        3D, or events in space and time.
        """
        ...

    @property
    def needs_tick(self) -> bool:
        """Something moves by itself: `tick` should come at 60 Hz instead of when something happened."""
        ...

    def show(self, active: bool) -> None:
        """Show the controls of the mode, or hide them."""
        ...

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened; whether or not the mode is active."""
        ...

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """While active: make what is shown follow the state. `now_us` is the time cursor."""
        ...

    def clicked(self, x: float, y: float) -> None:
        """While active: a click on the sheet of pictures, in sheet pixels."""
        ...

    def close(self) -> None:
        """The browser is gone."""
        ...


ModeFactory = Callable[[ModeHost], Mode]


def do_in_pool(host: ModeHost, act: Callable[[], object]) -> None:
    """Do it in the pool; a RallyscopeError is shown to the person."""

    def work() -> None:
        try:
            act()
        except RallyscopeError as error:
            failed = error
            host.later(lambda: host.report(failed))

    host.pool.submit(work)


LARGEST_DOWNLOAD: Final = 1_000_000_000
"""Bytes; a download goes through this process's memory."""
STYLE: Final = "padding:2px 1em;font-size:13px;line-height:1.5"


def download_export(host: ModeHost, name: str) -> None:
    """Send it; reading and sending go on in the pool.

    Raises:
        CommandError: if there is no such export, or it is too large.
    """
    path = host.services.exporter.path_of(name)
    if path.stat().st_size > LARGEST_DOWNLOAD:
        raise CommandError("too large to download through the browser", got=name, remedy=f"it is here: {path}")
    send = host.client.send_file_download
    host.pool.submit(lambda: send(path.name, path.read_bytes(), save_immediately=True))


def state_html(state: ExportState | None) -> str:
    """One line about the latest export."""
    if state is None:
        return f"<div style='{STYLE}'>Files are made in the folder <b>exports</b> of the workspace.</div>"
    if state.running:
        left = "" if state.left_s is None else f", about {max(1, round(state.left_s))} s left"
        text = f"{html_text(state.name)}: {percent(state.share)}{left}"
        return f"<div style='{STYLE}'>{text}</div>"
    colour = theme.BAD if state.failed else theme.MUTED if state.message == "cancelled" else theme.GOOD
    text = f"{html_text(state.message)} ({state.seconds:.0f} s)"
    return f"<div style='{STYLE};color:{colour}'>{text}</div>"
