"""The gateway before viser: it starts viser's server, and checks every request.

viser 1.1 checks neither Host nor Origin, knows no token, and leaves no room for a check. A proxy before it would
leave its own port open to every page in the browser, so the check is put where viser starts its websocket server:
requests are judged in viser's own process and its messages take no further step. `Gateway` refuses to start where
that hook was not used, and a test asks as a foreign page would.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import gzip
import http
import inspect
import json
import secrets
import threading
import urllib.parse
from collections.abc import Awaitable, Callable, Iterator
from contextvars import ContextVar
from http.cookies import CookieError, SimpleCookie
from importlib import resources
from typing import TYPE_CHECKING, Any, Final

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from app.theme import apply_theme
from app.viser_parts import allow_threads, check_parts, moved_part, read_page, websocket_server
from app.web.access_policy import TOKEN_COOKIE, Admission, RequestOrigin, check_address, port_taken
from app.web.pages import PageConnection, Pages

if TYPE_CHECKING:
    from viser.infra import WebsockClientConnection

SCRIPTS: Final = (
    "identity.js",
    "bridge.js",
    "splash.js",
    "drawing.js",
    "visible.js",
    "sky.js",
    "reconnect.js",
    "link.js",
    "fields.js",
    "clicks.js",
    "windows.js",
    "keyboard.js",
    "notes.js",
    "hand.js",
    "enlarge.js",
    "timebar.js",
    "texts.js",
    "stale.js",
    "panes.js",
    "lower.js",
    "tooltips.js",
    "upload.js",
    "files.js",
    "label_files.js",
    "tour.js",
    "names.js",
    "charts.js",
    "balls.js",
)
"""Scripts in the order in which they run; each adds to the object `rallyscope`."""


@functools.cache
def page_html() -> bytes:
    """The whole page, UTF-8.

    Raises:
        PackageError: if viser's page is not built as we know it.
    """
    head, rest = read_page()
    folder = resources.files("app.web") / "page"
    script = "\n".join((folder / name).read_text("utf-8") for name in SCRIPTS)
    style = (folder / "style.css").read_text("utf-8")
    ours = f"<title>Rallyscope</title><style>{style}</style><script>const rallyscope = {{}};\n{script}</script>"
    return f"{head}{ours}{rest}".encode()


@functools.cache
def page_gzip() -> bytes:
    """The page as gzip."""
    return gzip.compress(page_html())


@functools.cache
def splash_film() -> bytes:
    """Film that the page shows until its first view is complete, WebP."""
    return (resources.files("app.web") / "page" / "rally.webp").read_bytes()


def refusal_html(title: str, text: str, *, form: bool = False) -> bytes:
    """A small page that says why not; with a field for the token if `form`. Both texts are our own."""
    field = (
        "<form method='get' action='/'><input name='token' type='password' aria-label='Token' autofocus> "
        "<button>Open</button></form>"
    )
    return (
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Rallyscope</title>"
        "<body style='font:16px system-ui;background:#1a1b1e;color:#ddd;padding:3em;max-width:44em'>"
        f"<h1 style='color:#ff8c28'>{title}</h1><p>{text}</p>{field if form else ''}</body></html>"
    ).encode()


BROWSER_COOKIE: Final = "rallyscope-browser"
BROWSER_COOKIE_S: Final = 400 * 86_400
PAGE_PATH: Final = "/rallyscope/page"
UPLOAD_PATH: Final = "/rallyscope/upload"
ALIVE_PATH: Final = "/rallyscope/alive"
FILM_PATH: Final = "/rallyscope/rally.webp"
MAX_ID_LENGTH: Final = 64
PING_EVERY_S: Final = 20.0
PATIENCE_S: Final = 120.0
"""A page that does not answer for so long is gone. One of a busy machine may take half a minute, and would be loaded
anew while a person types in it."""
SAFETY_HEADERS: Final = {
    "Content-Security-Policy": "frame-ancestors 'none'",  # a foreign page shows ours in no frame to have it clicked
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # a link with a token goes to nobody
    "Cache-Control": "no-cache",
}
_starting = threading.Lock()
Handler = Callable[[ServerConnection], Awaitable[None]]


class Gateway:
    """A viser server that lets in only whom the rules admit."""

    def __init__(self, host: str, port: int, admission: Admission) -> None:
        """Starts to listen at once; the port has been checked to be free."""
        self.pages = Pages()
        """Messages beside viser's."""
        self._admission = admission
        self._visits: dict[int, PageConnection] = {}
        self._visiting: ContextVar[PageConnection] = ContextVar("visit")
        self._open = False
        with _starting, self._hooked() as used:
            self.server = viser.ViserServer(host=host, port=port, verbose=False)
            """viser's own."""
        if not used:
            self.server.stop()
            raise moved_part("its call of websockets.asyncio.server.serve")
        infra = websocket_server(self.server)
        allow_threads(infra)
        infra.on_client_connect(self._come)
        infra.on_client_disconnect(self._go)
        self._open = True

    def visit(self, client: viser.ClientHandle) -> PageConnection:
        """What the page of this client said when it came."""
        return self._visits.get(client.client_id, PageConnection())

    def _come(self, client: WebsockClientConnection) -> None:
        allow_threads(client)
        self._visits[client.client_id] = self._visiting.get()

    def _go(self, client: WebsockClientConnection) -> None:
        self._visits.pop(client.client_id, None)

    @contextlib.contextmanager
    def _hooked(self) -> Iterator[list[bool]]:
        """Until it ends, what starts a websocket server starts one with our judgement in it."""
        original = websockets.asyncio.server.serve
        used: list[bool] = []

        def serve(handler: Handler, *address: Any, process_request: Any, **options: Any) -> Any:
            used.append(True)

            async def judged(connection: ServerConnection, request: Request) -> Response | None:
                while not self._open:
                    await asyncio.sleep(0.01)
                if (answer := self._answer(request)) is not None:
                    return answer
                answer = process_request(connection, request)
                return await answer if inspect.isawaitable(answer) else answer

            keeping = {"ping_interval": PING_EVERY_S, "ping_timeout": PATIENCE_S}
            return original(self._handle(handler), *address, process_request=judged, **{**options, **keeping})

        websockets.asyncio.server.serve = serve  # type: ignore[assignment]
        try:
            yield used
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]

    def _answer(self, request: Request) -> Response | None:
        """Our answer to a request; None leaves it to viser."""
        path, query = _split(request.path)
        caller = _caller(request, query.get("token"))
        verdict = self._admission.judge(caller)
        if verdict in ("wrong host", "wrong origin"):
            return _refuse(http.HTTPStatus.FORBIDDEN, verdict)
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if verdict == "needs token":
            return _refuse(http.HTTPStatus.UNAUTHORIZED, verdict)
        if is_socket:
            return None
        if self._admission.is_token(query.get("token")):
            return self._welcome(request, path)
        if path == ALIVE_PATH:
            return _response(http.HTTPStatus.OK, json.dumps({"alive": True}).encode(), "application/json")
        if path == FILM_PATH:
            return _film()
        if path in ("/", "/index.html"):
            return _page(request)
        return None

    def _welcome(self, request: Request, path: str) -> Response:
        """The token goes out of the address and into a cookie."""
        answer = _response(http.HTTPStatus.SEE_OTHER, b"", "text/plain")
        answer.headers["Location"] = _without_token(request.path) if path in ("/", "/index.html") else "/"
        answer.headers["Set-Cookie"] = f"{TOKEN_COOKIE}={self._admission.cookie}; HttpOnly; SameSite=Lax; Path=/"
        return answer

    def _handle(self, viser_handler: Handler) -> Handler:
        async def handle(connection: ServerConnection) -> None:
            assert connection.request is not None
            path, query = _split(connection.request.path)
            page = query.get("page", "")[:MAX_ID_LENGTH]
            browser = _cookies(connection.request).get(BROWSER_COOKIE, "")[:MAX_ID_LENGTH]
            if path == PAGE_PATH:
                await self.pages.serve(page, connection)
                return
            if path == UPLOAD_PATH:
                await self.pages.uploads.serve(page, browser, connection)
                return
            self._visiting.set(PageConnection(page, browser, query.get("link", "")))
            await viser_handler(connection)

        return handle


def open_gateway(host: str, port: int, admission: Admission | None = None) -> Gateway:
    """A gateway at exactly this port, 0 for any free one; viser itself would silently take the next one.

    Raises:
        CommandError: if the address cannot be used, or other machines could connect without a token.
        PackageError: if viser is a version that lacks what we use of it.
    """
    check_address(host, port)
    check_parts()
    front = Gateway(host, port, admission or Admission.of_address(host, None))
    if port not in (0, front.server.get_port()):  # another was quicker
        front.server.stop()
        raise port_taken(host, port, "it was just taken")
    apply_theme(front.server)  # before a page comes: it would show a light page, and draw viser's sky
    return front


def _split(target: str) -> tuple[str, dict[str, str]]:
    """Path and query of a request; of a value given twice the last counts."""
    path, _, query = target.partition("?")
    try:
        return path, dict(urllib.parse.parse_qsl(query, max_num_fields=32))
    except ValueError:
        return path, {}


def _without_token(target: str) -> str:
    path, _, query = target.partition("?")
    kept = [(key, value) for key, value in urllib.parse.parse_qsl(query, max_num_fields=32) if key != "token"]
    return path + ("?" + urllib.parse.urlencode(kept) if kept else "")


def _caller(request: Request, token: str | None) -> RequestOrigin:
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    authorization = request.headers.get_all("Authorization")
    if token is None and len(authorization) == 1 and authorization[0].lower().startswith(("token ", "bearer ")):
        token = authorization[0].split(" ", 1)[1].strip()
    return RequestOrigin(
        host=hosts[0] if len(hosts) == 1 else None,
        origin=origins[0] if len(origins) == 1 else None,
        has_origin=bool(origins),
        cookie=_cookies(request).get(TOKEN_COOKIE),
        token=token,
    )


def _cookies(request: Request) -> dict[str, str]:
    try:
        parsed = SimpleCookie("; ".join(request.headers.get_all("Cookie")))
    except CookieError:
        return {}
    return {name: morsel.value for name, morsel in parsed.items()}


def _page(request: Request) -> Response:
    packed = "gzip" in request.headers.get("Accept-Encoding", "")
    answer = _response(http.HTTPStatus.OK, page_gzip() if packed else page_html(), "text/html; charset=utf-8")
    if packed:
        answer.headers["Content-Encoding"] = "gzip"
    if BROWSER_COOKIE not in _cookies(request):
        cookie = f"{BROWSER_COOKIE}={secrets.token_hex(16)}; HttpOnly; SameSite=Lax; Path=/; Max-Age={BROWSER_COOKIE_S}"
        answer.headers["Set-Cookie"] = cookie
    return answer


def _film() -> Response:
    answer = _response(http.HTTPStatus.OK, splash_film(), "image/webp")
    del answer.headers["Cache-Control"]
    answer.headers["Cache-Control"] = "max-age=86400"  # the same for all pages
    return answer


def _refuse(status: http.HTTPStatus, verdict: str) -> Response:
    texts = {
        "wrong host": "It answers only as localhost, 127.0.0.1 or [::1]. From another machine use a tunnel: "
        "ssh -L 8080:localhost:8080 with that machine's name, then open http://localhost:8080.",
        "wrong origin": "Only its own page may connect.",
        "needs token": "Open the link with the token that the server printed when it started, or type the token.",
    }
    title = "Address not allowed" if status == http.HTTPStatus.FORBIDDEN else "Token required"
    body = refusal_html(title, texts[verdict], form=verdict == "needs token")
    return _response(status, body, "text/html; charset=utf-8")


def _response(status: http.HTTPStatus, body: bytes, kind: str) -> Response:
    headers = Headers(SAFETY_HEADERS)
    headers["Content-Type"] = kind
    headers["Content-Length"] = str(len(body))
    return Response(status.value, status.phrase, headers, body)
