"""The door before a real server: what it answers to whom."""

import gzip
import http.client
import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from app.viser_parts import CrossThreadEvent, websocket_server
from app.web import Admission, Gateway
from app.web.gateway import FILM_PATH
from tests.waiting import PATIENCE_S, eventually

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
TOKEN = "correct-horse-battery-staple"


@pytest.fixture(scope="module")
def door() -> Iterator[Gateway]:
    door = Gateway("127.0.0.1", 0, Admission())
    yield door
    door.server.stop()


@pytest.fixture(scope="module")
def locked() -> Iterator[Gateway]:
    door = Gateway("127.0.0.1", 0, Admission(token=TOKEN))
    yield door
    door.server.stop()


def get(door: Gateway, path: str = "/", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", door.server.get_port(), timeout=PATIENCE_S)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, body


def socket_status(door: Gateway, path: str = "/", **options) -> int:
    """101 where the websocket is taken."""
    url = f"ws://127.0.0.1:{door.server.get_port()}{path}"
    try:
        connect(url, subprotocols=[PROTOCOL], **options).close()
    except InvalidStatus as refused:
        return refused.response.status_code
    return 101


def test_the_page_is_visers_with_our_script_and_may_stand_in_no_frame(door: Gateway) -> None:
    status, headers, body = get(door)
    assert status == 200 and b"<title>Rallyscope</title>" in body and b"rallyscope.connect" in body
    assert body.index(b"const rallyscope") < body.index(b'<div id="root">')
    assert "frame-ancestors 'none'" in headers["content-security-policy"] and headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer" and headers["x-content-type-options"] == "nosniff"
    packed = get(door, "/?fixedDpr=1", Accept_Encoding="gzip")
    assert packed[1]["content-encoding"] == "gzip" and gzip.decompress(packed[2]) == body


def test_a_page_that_asks_while_the_door_is_being_opened_waits_for_it(monkeypatch) -> None:
    """A page that was told "starting" would show just that, for good."""
    answers: list[int] = []
    found_closed: list[bool] = []

    def ask(port: int) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        connection.request("GET", "/")
        answers.append(connection.getresponse().status)
        connection.close()

    class SlowServer(viser.ViserServer):
        def __init__(self, **options: Any) -> None:
            super().__init__(**options)
            self.asking = threading.Thread(target=ask, args=(self.get_port(),))
            self.asking.start()
            eventually(lambda: len(found_closed) > 1, "the page to ask, and to be kept waiting")
            assert self.asking.is_alive() and not answers

    class WatchedGateway(Gateway):
        """Notes each look of a request that finds it closed."""

        @property
        def _open(self) -> bool:
            is_open = self.__dict__["_open"]
            if not is_open:
                found_closed.append(True)
            return is_open

        @_open.setter
        def _open(self, is_open: bool) -> None:
            self.__dict__["_open"] = is_open

    monkeypatch.setattr(viser, "ViserServer", SlowServer)
    door = WatchedGateway("127.0.0.1", 0, Admission())
    assert isinstance(door.server, SlowServer)
    door.server.asking.join()
    door.server.stop()
    assert answers == [200]


def test_a_browser_is_known_again_by_a_cookie_that_no_script_reads(door: Gateway) -> None:
    cookie = get(door)[1]["set-cookie"]
    assert cookie.startswith("rallyscope-browser=") and "HttpOnly" in cookie and "SameSite=Lax" in cookie
    assert "set-cookie" not in get(door, Cookie=cookie.split(";")[0])[1]
    assert get(door)[1]["set-cookie"].split(";")[0] != cookie.split(";")[0]


@pytest.mark.parametrize("path", ["/", "/index.html", "/rallyscope/alive", "/no-such-file"])
def test_a_foreign_host_gets_nothing(door: Gateway, path: str) -> None:
    status, _, body = get(door, path, Host="evil.example:8080")
    assert status == 403 and b"rallyscope." not in body and b"ssh -L" in body


def test_a_websocket_of_a_foreign_page_is_refused_and_ours_is_taken(door: Gateway) -> None:
    port = door.server.get_port()
    assert socket_status(door, origin=Origin(f"http://127.0.0.1:{port}")) == 101
    assert socket_status(door) == 101  # no browser: a program of this machine
    for origin in ("http://evil.example", "null", f"http://localhost:{port}", "http://127.0.0.1:1"):
        assert socket_status(door, origin=Origin(origin)) == 403
        assert socket_status(door, "/rallyscope/page?page=x", origin=Origin(origin)) == 403
    assert socket_status(door, additional_headers={"Host": "evil.example"}) == 403


def test_the_film_of_the_splash_page_is_there(door: Gateway) -> None:
    assert FILM_PATH.encode() in get(door)[2]
    status, headers, body = get(door, FILM_PATH)
    assert status == 200 and headers["content-type"] == "image/webp" and body[:4] == b"RIFF" and body[8:12] == b"WEBP"
    assert headers["cache-control"] == "max-age=86400"


def test_it_says_that_it_is_alive(door: Gateway) -> None:
    status, _, body = get(door, "/rallyscope/alive")
    assert status == 200 and json.loads(body) == {"alive": True}


def test_without_the_token_there_is_only_a_field_for_it(locked: Gateway) -> None:
    for path in ("/", "/rallyscope/alive", "/?token=wrong", "/index.html?token="):
        status, headers, body = get(locked, path)
        assert status == 401 and b"name='token'" in body and b"rallyscope." not in body and "set-cookie" not in headers
    assert socket_status(locked) == 401 and socket_status(locked, "/rallyscope/page?page=x") == 401


def test_the_link_with_the_token_leaves_a_cookie_and_an_address_without_it(locked: Gateway) -> None:
    status, headers, _ = get(locked, f"/?fixedDpr=1&token={TOKEN}")
    assert status == 303 and headers["location"] == "/?fixedDpr=1" and TOKEN not in headers["set-cookie"]
    assert "HttpOnly" in headers["set-cookie"]
    cookie = headers["set-cookie"].split(";")[0]
    assert get(locked, Cookie=cookie)[0] == 200
    assert socket_status(locked, additional_headers={"Cookie": cookie}) == 101
    assert socket_status(locked, additional_headers={"Authorization": f"token {TOKEN}"}) == 101
    assert get(locked, Cookie=cookie + "0")[0] == 401
    assert get(locked, Cookie=cookie, Host="evil.example")[0] == 403


@pytest.mark.parametrize("path", ["//evil.example?token=" + TOKEN, "/\\evil.example?token=" + TOKEN])
def test_the_way_on_from_the_token_leads_nowhere_else(locked: Gateway, path: str) -> None:
    status, headers, _ = get(locked, path)
    assert status == 303 and headers["location"] == "/"


@pytest.mark.parametrize(
    "path",
    ["/?" + "&".join(f"a{i}=1" for i in range(200)), "/?%ff%fe=%00", "/%2e%2e/%2e%2e/etc/passwd", "/..%5c..%5cx"],
)
def test_odd_requests_do_no_harm(door: Gateway, path: str) -> None:
    assert get(door, path)[0] in (200, 404)
    assert get(door)[0] == 200


def test_a_page_gets_the_latest_message_of_each_kind_and_is_heard(door: Gateway) -> None:
    heard: list = []
    door.pages.open("page-1", heard.append)
    for number in range(5):
        door.pages.send("page-1", "link", {"link": f"t={number}"})
    url = f"ws://127.0.0.1:{door.server.get_port()}/rallyscope/page?page=page-1"
    with connect(url) as socket:
        assert json.loads(socket.recv(timeout=PATIENCE_S)) == {"type": "link", "link": "t=4"}
        door.pages.send("page-1", "other", {"x": 1})
        assert json.loads(socket.recv(timeout=PATIENCE_S)) == {"type": "other", "x": 1}
        for text in ("no json", "[1]", '{"type": 3}', '{"no": "type"}', "[" * 50_000, '{"type": "a", "t": 1}', b"\x00"):
            socket.send(text)
        socket.send(json.dumps({"type": "big", "text": "x" * 100_000}))
        socket.send('{"type": "last"}')
        eventually(lambda: len(heard) >= 2, "both messages to be heard", lambda: heard)
        assert [message["type"] for message in heard] == ["a", "last"]
        door.pages.close("page-1", heard.append)
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=PATIENCE_S)


def test_a_page_goes_on_with_the_session_that_takes_over(door: Gateway) -> None:
    """viser's websocket broke and came anew, before the server knew that the old one was gone."""
    first: list = []
    second: list = []
    door.pages.open("page-2", first.append)
    door.pages.send("page-2", "link", {"link": "old"})
    with connect(f"ws://127.0.0.1:{door.server.get_port()}/rallyscope/page?page=page-2") as socket:
        assert json.loads(socket.recv(timeout=PATIENCE_S))["link"] == "old"
        door.pages.open("page-2", second.append)
        door.pages.send("page-2", "link", {"link": "new"})
        assert json.loads(socket.recv(timeout=PATIENCE_S))["link"] == "new"
        door.pages.close("page-2", first.append)
        socket.send('{"type": "seek"}')
        eventually(lambda: second, "the new session to hear the page")
        assert not first
        door.pages.close("page-2", second.append)
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=PATIENCE_S)


def test_a_page_that_gets_no_processor_for_a_minute_is_not_loaded_anew(door: Gateway) -> None:
    """Its websockets would be closed, and what is typed in it lost."""
    door.pages.open("page-3", print)
    with connect(f"ws://127.0.0.1:{door.server.get_port()}/rallyscope/page?page=page-3"):
        connection = eventually(lambda: door.pages._pages["page-3"].connection, "the page's websocket")
        assert connection.ping_timeout is not None and connection.ping_timeout > 60
    door.pages.close("page-3", print)


def test_any_thread_may_send_to_a_browser(door: Gateway) -> None:
    infra = websocket_server(door.server)
    come: list = []
    infra.on_client_connect(come.append)
    with connect(f"ws://127.0.0.1:{door.server.get_port()}/", subprotocols=[PROTOCOL]):
        eventually(lambda: come, "the browser")
    for connection in (infra, *come):
        assert isinstance(connection.get_message_buffer().message_event, CrossThreadEvent)
