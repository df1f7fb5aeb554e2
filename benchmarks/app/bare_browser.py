"""A client of the app that draws nothing, which presses keys and notes when pictures arrive, and the Chromium that
benches measure in.
"""

from __future__ import annotations

import inspect
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlencode

import msgspec.msgpack
import viser
import zstandard
from viser._messages import CommandTriggerMessage, GuiUpdateMessage, Message, ViewerCameraMessage
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.server import App
from app.session import Session
from app.web.gateway import BROWSER_COOKIE
from core.errors import CommandError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PROTOCOL: Final = f"viser-v{viser.__version__}"
LARGE_PICTURE: Final = "/sheet/0"
QUIET_S: Final = 0.6
CAMERA: Final = ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(0.0, 0.0, -5.0),
    fov=0.8,
    near=0.01,
    far=100.0,
    image_height=720,
    image_width=880,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, -1.0, 0.0),
)
"""Where it looks from: viser serves nobody before it knows that."""


class BareBrowser:
    """Connected as soon as it is made."""

    def __init__(self, port: int, *, cookie: str = "", link: str = "") -> None:
        """`cookie` is what it is known by when it comes again, `link` that of the address it opens."""
        self._socket = connect_to(port, link=link, cookie=cookie)
        self.pictures = 0
        """Large pictures that have arrived."""
        self._arrived = threading.Condition()
        self._last_s = 0.0
        self._commands: dict[str, str] = {}
        self._send(CAMERA)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait_session(self, lab: App, timeout_s: float = 60.0) -> Session:
        """The app's session of this client, with its recording open."""
        self.wait_until(
            lambda: lab.sessions and lab.sessions[0].state is not None, "the app to take this client", timeout_s
        )
        return lab.sessions[0]

    def trigger(self, command: str, timeout_s: float = 30.0) -> None:
        """Press the key of a command, named as in the palette."""
        self.wait_until(lambda: command in self._commands, f"a command {command!r}", timeout_s)
        self._send(CommandTriggerMessage(self._commands[command]))

    def set_value(self, control: str, value: object) -> None:
        """Change a control of this id, as a person does who clicks on it or types."""
        self._send(GuiUpdateMessage(control, {"value": value}))

    def wait_picture(self, timeout_s: float, *, after: int = 0) -> None:
        """Until more large pictures than `after` have arrived."""
        with self._arrived:
            if not self._arrived.wait_for(lambda: self.pictures > after, timeout_s):
                raise TimeoutError("no picture arrived")

    def wait_quiet(self, timeout_s: float = 60.0) -> None:
        """Until nothing has arrived for a while: the neighbours are ready, too."""
        time.sleep(QUIET_S)
        self.wait_until(lambda: time.monotonic() - self._last_s >= QUIET_S, "messages to cease", timeout_s)

    def wait_until(self, condition: Callable[[], object], what: str, timeout_s: float) -> None:
        """Until the condition holds.

        Raises:
            TimeoutError: if it does not in time.
        """
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"waited {timeout_s:g} s for {what}")
            time.sleep(0.02)

    def close(self) -> None:
        """Leave the page and end its connection."""
        self._socket.close()
        self._reader.join(timeout=5)

    def _send(self, message: Message) -> None:
        self._socket.send(encoded(message))

    def _read(self) -> None:
        for frame in self._socket:
            messages = messages_in(frame)
            self._last_s = time.monotonic()
            for message in messages:
                self._take(message)

    def _take(self, message: Mapping[str, Any]) -> None:
        if message["type"] == "RegisterCommandMessage":
            self._commands[message["props"]["label"]] = message["uuid"]
        elif message.get("name") == LARGE_PICTURE and "_data" in message.get("updates", {}):
            with self._arrived:
                self.pictures += 1
                self._arrived.notify_all()


def connect_to(port: int, *, link: str = "", cookie: str = "") -> ClientConnection:
    """A websocket to a viser server on this machine, as its page opens it."""
    # A browser asks nobody whether he is still there; before 15.0 websockets did not ask either, nor know the word.
    quiet: dict[str, Any] = {"ping_interval": None} if "ping_interval" in inspect.signature(connect).parameters else {}
    return connect(
        f"ws://127.0.0.1:{port}/?{urlencode({'link': link})}",
        subprotocols=[Subprotocol(PROTOCOL)],
        max_size=None,
        compression=None,
        additional_headers={"Cookie": f"{BROWSER_COOKIE}={cookie}"} if cookie else None,
        **quiet,
    )


def encoded(message: Message) -> bytes:
    """What is sent for a message."""
    return msgspec.msgpack.encode(message.as_serializable_dict())


def messages_in(frame: str | bytes) -> list[Mapping[str, Any]]:
    """What the server sent at once."""
    assert isinstance(frame, bytes)
    length = int.from_bytes(frame[8:16], "little")
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + length]))["messages"]


BROWSER_FLAGS: Final = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WINDOW: Final = (1280, 720)


def find_chromium() -> str | None:
    """The browser, if there is one and something to drive it with."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return None
    return os.environ.get("RALLYSCOPE_CHROMIUM") or shutil.which("chromium")


@contextmanager
def measuring_browser() -> Iterator[Browser]:
    """While it is open.

    Raises:
        CommandError: if there is none.
    """
    program = find_chromium()
    if program is None:
        raise CommandError("no Chromium to measure with", remedy="set RALLYSCOPE_CHROMIUM to one")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(BROWSER_FLAGS))
        with closing(browser):
            yield browser


MOVES: Final = frozenset({"SetPositionMessage", "SetOrientationMessage", "SceneNodeUpdateMessage"})


class Visitor(BareBrowser):
    """Connected as soon as it is made."""

    def __init__(self, port: int) -> None:
        self._controls: dict[str, str] = {}
        self._contents: dict[str, str] = {}
        """HTML of the panels, by their id."""
        self.updates: list[float] = []
        """When the server changed what the scene shows, monotonic seconds; many changes at once are one."""
        super().__init__(port)

    def press(self, label: str, timeout_s: float = 60.0) -> None:
        """Click the button."""
        self.change(label, True, timeout_s)

    def change(self, label: str, value: object, timeout_s: float = 60.0) -> None:
        """Set a field, a choice or a box."""
        self.wait_until(lambda: label in self._controls, f"a control {label!r}", timeout_s)
        self.set_value(self._controls[label], value)

    def wait_text(self, text: str, timeout_s: float = 60.0) -> None:
        """Until it stands in some panel."""
        self.wait_until(lambda: any(text in html for html in self._contents.copy().values()), repr(text), timeout_s)

    def wait_rally(self, timeout_s: float) -> None:
        """Until the live rally moves here; what moves while the app is prepared is a recorded one."""
        self.wait_until(lambda: "Serve speed [m/s]" in self._controls, "the live rally", timeout_s)
        seen = len(self.updates)
        self.wait_until(lambda: len(self.updates) > seen + 50, "the live rally to move", timeout_s)

    def rate(self, seconds: float, until_s: float) -> float:
        """Updates a second in the time before `until_s`."""
        return sum(until_s - seconds < at_s <= until_s for at_s in self.updates) / seconds

    def _take(self, message: Mapping[str, Any]) -> None:
        super()._take(message)
        kind = message["type"]
        content = (message.get("props") or message.get("updates") or {}).get("content")
        if isinstance(content, str):
            self._contents[message["uuid"]] = content
        if kind.startswith("Gui") and isinstance(message.get("props"), dict):
            label = message["props"].get("label")
            if label:
                self._controls[label] = message["uuid"]
        elif kind in MOVES and message["name"].startswith("/world/"):
            now_s = time.monotonic()
            if not self.updates or now_s - self.updates[-1] > 0.005:
                self.updates.append(now_s)
