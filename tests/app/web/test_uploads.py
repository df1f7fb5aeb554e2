"""Files that browsers send: what is taken, what is refused, and that nothing is left of what is refused."""

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from socket import SHUT_RDWR

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from app.web import Admission, Gateway
from app.web.uploads import MAX_AT_ONCE, MAX_LABELS_BYTES, MAX_PIECE_BYTES, MAX_UPLOAD_BYTES, safe_name
from tests.waiting import PATIENCE_S, eventually

PAGE = "page-that-is-open"


@pytest.fixture(scope="module")
def door() -> Iterator[Gateway]:
    door = Gateway("127.0.0.1", 0, Admission())
    door.pages.uploads._piece_within_s = PATIENCE_S
    yield door
    door.server.stop()


@pytest.fixture
def folder(door: Gateway, tmp_path: Path) -> Path:
    door.pages.uploads.new_folder = lambda: Path(tempfile.mkdtemp(dir=tmp_path))
    return tmp_path


@pytest.fixture
def received(door: Gateway, folder: Path) -> Iterator[list[Path]]:
    received: list[Path] = []
    door.pages.uploads.open(PAGE, received.append)
    yield received
    door.pages.uploads.close(PAGE)


def uploading(door: Gateway, page: str = PAGE, **options) -> ClientConnection:
    return connect(f"ws://127.0.0.1:{door.server.get_port()}/rallyscope/upload?page={page}", **options)


def said(socket: ClientConnection) -> dict:
    return json.loads(socket.recv(timeout=PATIENCE_S))


def announce(socket: ClientConnection, name: object, size: object) -> dict:
    socket.send(json.dumps({"name": name, "size": size}))
    return said(socket)


def test_a_file_arrives_whole_in_a_folder_of_its_own(door, folder, received) -> None:
    data = bytes(range(256)) * 4000
    with uploading(door) as socket:
        assert announce(socket, "my clip.RAW", len(data)) == {"ready": True}
        for start in range(0, len(data), 300_000):
            socket.send(data[start : start + 300_000])
            assert said(socket)["got"] == min(start + 300_000, len(data))
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=PATIENCE_S)
    (path,) = received
    assert path.name == "my-clip.raw" and path.read_bytes() == data and path.parent.parent == folder


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("../../etc/passwd", "passwd"),
        ("..\\..\\evil.raw", "evil.raw"),
        ("<script>alert(1)</script>.raw", "script.raw"),
        ("a\x00b.npz", "a-b.npz"),
        ("..", "recording"),
        ("", "recording"),
        ("...raw", "recording.raw"),
        (".hidden", "recording.hidden"),
        ("x" * 5000 + ".csv", "x" * 56 + ".csv"),
        ("Schläger 1.es", "Schl-ger-1.es"),
        ("clip.<b>", "clip-b"),
        ("-rf.dat", "rf.dat"),
        ("\u202egpj.raw", "gpj.raw"),
    ],
)
def test_names_become_plain_ones(name: str, safe: str) -> None:
    assert safe_name(name) == safe and "/" not in safe and not safe.startswith(".")


@pytest.mark.parametrize(
    ("name", "size", "says"),
    [
        ("a.raw", MAX_UPLOAD_BYTES + 1, "up to 200 MB"),
        ("a.raw", 10**30, "up to 200 MB"),
        ("a.raw", 0, "empty"),
        ("a.raw", -1, "upload was invalid"),
        ("a.raw", 1.5, "upload was invalid"),
        ("a.raw", True, "upload was invalid"),
        ("a.raw", "12", "upload was invalid"),
        (None, 12, "upload was invalid"),
        (["a"], 12, "upload was invalid"),
    ],
)
def test_what_cannot_be_a_file_is_refused_before_a_byte_of_it(door, folder, received, name, size, says) -> None:
    with uploading(door) as socket:
        assert says in announce(socket, name, size)["refused"]
    assert not list(folder.iterdir()) and not received


def test_labels_go_to_who_takes_labels_and_have_a_limit_of_their_own(door, folder, received) -> None:
    def announce_labels(purpose: object, size: int) -> dict:
        with uploading(door) as socket:
            socket.send(json.dumps({"name": "a.csv", "size": size, "purpose": purpose}))
            answer = said(socket)
            if "ready" in answer:
                socket.send(b"x" * size)
                said(socket)
        return answer

    assert "takes no such file" in announce_labels("labels", 3)["refused"]
    labels: list[Path] = []
    door.pages.uploads.open(PAGE, labels.append, "labels")
    assert announce_labels("labels", 3) == {"ready": True}
    eventually(lambda: labels, "the labels")
    assert labels[0].read_bytes() == b"xxx" and not received
    assert "up to 50 MB" in announce_labels("labels", MAX_LABELS_BYTES + 1)["refused"]
    for purpose in ("plugin", 1, ["labels"], None):
        assert "upload was invalid" in announce_labels(purpose, 3)["refused"]


@pytest.mark.parametrize("first", ["no json", "[" * 50_000, "[1]", b"\x00\x01"])
def test_what_is_no_announcement_is_refused(door, folder, received, first) -> None:
    with uploading(door) as socket:
        socket.send(first)
        assert "refused" in said(socket)
    assert not list(folder.iterdir())


def test_more_than_was_said_is_refused_and_nothing_is_left(door, folder, received) -> None:
    with uploading(door) as socket:
        announce(socket, "a.raw", 1000)
        socket.send(b"x" * 999)
        said(socket)
        socket.send(b"x" * 2)
        assert "More data came" in said(socket)["refused"]
    eventually(lambda: not list(folder.iterdir()), "the folder to be empty")
    assert not received


def test_a_piece_that_is_too_large_ends_it_and_nothing_is_left(door, folder, received) -> None:
    with uploading(door) as socket:
        announce(socket, "a.raw", 4 * MAX_PIECE_BYTES)
        socket.send(b"x" * (MAX_PIECE_BYTES + 1))
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=PATIENCE_S)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009
    eventually(lambda: not list(folder.iterdir()), "the folder to be empty")
    assert not received


def test_one_that_is_given_up_in_the_middle_leaves_nothing(door, folder, received) -> None:
    socket = uploading(door)
    announce(socket, "a.raw", 1000)
    socket.send(b"x" * 500)
    said(socket)
    assert [path.name for path in folder.rglob("*.raw")] == ["a.raw"]
    socket.socket.shutdown(SHUT_RDWR)  # no word of goodbye
    eventually(lambda: not list(folder.iterdir()), "the folder to be empty")
    assert not received


def test_one_that_stops_sending_is_given_up(door, folder, received) -> None:
    uploads = door.pages.uploads
    usual_s = uploads._piece_within_s
    try:
        with uploading(door) as socket:
            announce(socket, "a.raw", 1000)
            uploads._piece_within_s = 0.2  # for the next piece but one, and for the next if its wait has not begun
            socket.send(b"x" * 500)
            answer = said(socket)
            if "refused" not in answer:
                assert answer == {"got": 500}
                answer = said(socket)
            assert "timed out" in answer["refused"]
    finally:
        uploads._piece_within_s = usual_s
    eventually(lambda: not list(folder.iterdir()), "the folder to be empty")


def test_strangers_and_pages_that_are_not_open_send_nothing(door, folder, received) -> None:
    for origin in ("http://evil.example", "null"):
        with pytest.raises(InvalidStatus) as refused:
            uploading(door, origin=Origin(origin))
        assert refused.value.response.status_code == 403
    with pytest.raises(InvalidStatus):
        uploading(door, additional_headers={"Host": "evil.example"})
    with uploading(door, page="another") as socket:
        assert "open page" in said(socket)["refused"]


def test_a_browser_sends_one_at_a_time_and_only_so_many_do(door, folder, received) -> None:
    def as_browser(number: int) -> ClientConnection:
        return uploading(door, additional_headers={"Cookie": f"rallyscope-browser={number:032x}"})

    sending = [as_browser(number) for number in range(MAX_AT_ONCE)]
    for socket in sending:
        assert announce(socket, "a.raw", 10) == {"ready": True}
    with as_browser(0) as again:
        assert "one at a time" in said(again)["refused"]
    with as_browser(99) as another:
        assert "in a moment" in said(another)["refused"]
    for socket in sending:
        socket.close()
    eventually(lambda: not list(folder.iterdir()), "the folder to be empty")
    with as_browser(0) as again:
        assert announce(again, "a.raw", 10) == {"ready": True}


def test_a_disk_without_room_is_said(door, folder, received, monkeypatch) -> None:
    monkeypatch.setattr("app.web.uploads.KEPT_FREE_BYTES", 10**18)
    with uploading(door) as socket:
        assert "too full" in announce(socket, "a.raw", 10)["refused"]
    assert not list(folder.iterdir())
