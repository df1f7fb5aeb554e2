"""Parts of viser and websockets that are not their public interface, all in one place, and a check that they are there.

Releases of viser 1.x may move them. Then the start ends with one line that names the part, instead of a page that
lacks something.
"""

from __future__ import annotations

import asyncio
import importlib
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from core.errors import PackageError

if TYPE_CHECKING:
    import viser

TESTED: Final = "1.1.1"
"""Version of viser that the tests run with, as in constraints.txt."""
PARTS: Final = (
    ("viser", "infra.WebsockClientConnection"),
    ("viser.infra._async_message_buffer", "AsyncMessageBuffer.push"),
    ("viser._gui_api", "svg_from_icon"),
    ("viser._gui_handles", "svg_from_icon"),
    ("viser._icons", "ICONS_DIR"),
    ("websockets.asyncio.server", "serve"),
    ("websockets.asyncio.server", "ServerConnection"),
)
"""Modules and what is used of them."""
PAGE: Final = "client/build/index.html"
TITLE: Final = "<title>Viser</title>"
"""Part of viser's page that ours replaces."""
ICONS: Final = "tabler-icons.zip"


def check_parts() -> None:
    """Check that every part is where we look for it.

    Raises:
        PackageError: naming the first that is not.
    """
    for module, attribute in PARTS:
        _part(module, attribute)
    if not icons_file().is_file():
        raise moved_part(f"viser/_icons/{ICONS}")
    read_page()


def icon_users() -> tuple[Any, Any]:
    """Modules whose `svg_from_icon` turns an icon's name into SVG."""
    return importlib.import_module("viser._gui_api"), importlib.import_module("viser._gui_handles")


def icons_file() -> Path:
    """The archive of all icons, `<name>.svg` each."""
    return Path(_part("viser._icons", "ICONS_DIR")) / ICONS


def read_page() -> tuple[str, str]:
    """What viser's page has before and behind its title.

    Raises:
        PackageError: if there is no page, or it has no title.
    """
    try:
        html = (Path(str(importlib.import_module("viser").__file__)).parent / PAGE).read_text("utf-8")
    except OSError as error:
        raise moved_part(f"viser/{PAGE}") from error
    head, found, rest = html.partition(TITLE)
    if not found:
        raise moved_part(f"{TITLE} in viser/{PAGE}")
    return head, rest


def websocket_server(server: viser.ViserServer) -> Any:
    """The server of websockets within viser's, with `on_client_connect` and `on_client_disconnect`.

    Raises:
        PackageError: if it is not where it was.
    """
    found = getattr(server, "_websock_server", None)
    if found is None:
        raise moved_part("viser.ViserServer._websock_server")
    return found


class CrossThreadEvent(asyncio.Event):
    """An event that another thread may set, too: who waits is woken by the event loop only.

    viser sets the plain one from every thread that sends a message, and then once more in the event loop. The first
    raised an error where a waiter came or went meanwhile, and what the thread was about to do was left undone.
    """

    def set(self) -> None:
        """Set it; in the event loop, also wake who waits, even if it is set already."""
        self._value = True
        if asyncio._get_running_loop() is None:
            return
        for waiter in tuple(self._waiters):  # type: ignore[attr-defined]
            if not waiter.done():
                waiter.set_result(True)


def allow_threads(connection: Any) -> None:
    """Let any thread send messages over viser's server or one of its connections; before there is a waiter.

    Raises:
        PackageError: if its buffer is not where it was.
    """
    buffer = connection.get_message_buffer() if hasattr(connection, "get_message_buffer") else None
    if buffer is None or not isinstance(getattr(buffer, "message_event", None), asyncio.Event):
        raise moved_part("AsyncMessageBuffer.message_event")
    buffer.message_event = CrossThreadEvent()


def limit_messages(connection: Any, largest_bytes: int) -> None:
    """End a connection that gets a longer message, before all of it is in memory.

    Raises:
        PackageError: if the limit is not where it was.
    """
    for name in ("max_message_size", "max_size"):  # older releases of websockets have the second
        if hasattr(connection.protocol, name):
            setattr(connection.protocol, name, largest_bytes)
            return
    raise moved_part("ServerConnection.protocol.max_message_size")


def moved_part(name: str) -> PackageError:
    """The error that says that a part is not where it was."""
    return PackageError(
        f"this version of viser lacks {name}, which Rallyscope uses",
        expected=f"one like {TESTED}",
        got=f"viser {version('viser')}, websockets {version('websockets')}",
        remedy=f"pip install 'viser=={TESTED}'",
    )


def _part(module: str, attribute: str) -> Any:
    try:
        found: Any = importlib.import_module(module)
        for name in attribute.split("."):
            found = getattr(found, name)
    except (ImportError, AttributeError) as error:
        raise moved_part(f"{module}.{attribute}") from error
    return found
