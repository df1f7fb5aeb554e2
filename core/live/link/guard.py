"""Keys of the simulation link (CURVE), encrypted sockets, and access control for known clients (ZMQ's ZAP, RFC 27).

A folder of keys holds `public.key` and `secret.key`, its owner's pair, and of a server `clients/NAME.key`, the
public keys that it lets in; of a client `server.key`, the public key that the server must have. A key is 40
characters (Z85).
"""

from __future__ import annotations

import logging
import os
import stat
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from core.errors import LinkError
from core.files import BINARY, POSIX, numbered
from core.text import is_loopback

logger = logging.getLogger(__name__)


KEY_CHARACTERS: Final = 40
MAX_CLIENTS: Final = 1000
REMEDY: Final = "make keys with `rallyscope sim-server --make-keys DIR`"


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A public key and its secret one; neither is ever printed with the other."""

    public: bytes
    secret: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class ServerKeys:
    """Keys of a server: its own pair, and the accepted clients'."""

    own: KeyPair
    clients: frozenset[bytes]


@dataclass(frozen=True, slots=True)
class ClientKeys:
    """Keys of a client: its own pair, and its server's public key."""

    own: KeyPair
    server: bytes


def make_keys(folder: Path) -> tuple[Path, Path]:
    """Keys of a server and of a client that it lets in, in `server` and `client` of a folder; both folders.

    Where there is a server already it is left as it is and lets one more client in: `client-2`, and so on.

    Raises:
        LinkError: if the folder cannot be written, or the server's keys there cannot be used.
    """
    server = folder / "server"
    try:
        if not (server / "secret.key").exists():
            _write_pair(server)
        own = _read_pair(server)
        client = folder / next(name for name in numbered("client") if not (folder / name).exists())
        pair = _write_pair(client)
        (client / "server.key").write_bytes(own.public + b"\n")
        (server / "clients").mkdir(exist_ok=True)
        (server / "clients" / f"{client.name}.key").write_bytes(pair.public + b"\n")
    except OSError as error:
        raise LinkError("cannot write the keys", got=error.strerror, where=folder) from error
    return server, client


def read_server_keys(folder: Path) -> ServerKeys:
    """The keys of a server.

    Raises:
        LinkError: if a file is missing or no key, if others may read the secret one, or if nobody is let in.
    """
    pair = _read_pair(folder)
    paths = sorted((folder / "clients").glob("*.key"))[: MAX_CLIENTS + 1]
    if not 0 < len(paths) <= MAX_CLIENTS:
        raise LinkError(
            "no public keys of clients", expected=f"1 to {MAX_CLIENTS}", where=folder / "clients", remedy=REMEDY
        )
    return ServerKeys(pair, frozenset(_read_key(path) for path in paths))


def read_client_keys(folder: Path) -> ClientKeys:
    """The keys of a client.

    Raises:
        LinkError: if a file is missing or no key, or if others may read the secret one.
    """
    return ClientKeys(_read_pair(folder), _read_key(folder / "server.key"))


def _write_pair(folder: Path) -> KeyPair:
    public, secret = zmq.curve_keypair()
    folder.mkdir(parents=True, mode=0o700)
    with open(os.open(folder / "secret.key", os.O_WRONLY | os.O_CREAT | os.O_EXCL | BINARY, 0o600), "wb") as file:
        file.write(secret + b"\n")
    (folder / "public.key").write_bytes(public + b"\n")
    return KeyPair(public, secret)


def _read_pair(folder: Path) -> KeyPair:
    path = folder / "secret.key"
    pair = KeyPair(_read_key(folder / "public.key"), _read_key(path))
    mode = stat.S_IMODE(path.stat().st_mode)
    if POSIX and mode & 0o077:  # elsewhere the mode does not tell who may read
        remedy = f"chmod 600 {path}"
        raise LinkError(
            "others may read the secret key", expected="mode 600", got=f"{mode:o}", where=path, remedy=remedy
        )
    if zmq.curve_public(pair.secret) != pair.public:
        raise LinkError("public.key and secret.key are no pair", where=folder, remedy=REMEDY)
    return pair


def _read_key(path: Path) -> bytes:
    """A key; what an error says of the file is its name, never what it holds."""
    try:
        with path.open("rb") as file:
            key = file.read(KEY_CHARACTERS + 10).strip()
    except OSError as error:
        raise LinkError("cannot read the key", got=error.strerror, where=path, remedy=REMEDY) from error
    try:
        decoded = z85.decode(key) if len(key) == KEY_CHARACTERS else b""
    except Exception:  # noqa: BLE001 (z85 has several; what they say may quote the key)
        decoded = b""
    if len(decoded) != 32:
        raise LinkError(
            "not a key", expected=f"{KEY_CHARACTERS} characters of Z85", where=path, remedy=REMEDY
        ) from None
    return key


def split_address(address: str, *, lowest: int = 0) -> tuple[str, int]:
    """Host and port of `tcp://HOST:PORT`, where the next port is one, too.

    Raises:
        LinkError: if it is no such address, or its port is below `lowest`.
    """
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    digits = port.isascii() and port.isdigit() and len(port) < 6
    if not address.startswith("tcp://") or not host or not digits or not lowest <= int(port) <= 65534:
        raise LinkError("not an address", expected="tcp://HOST:PORT", got=repr(address[:100]))
    return host, int(port)


HANDSHAKE_MS: Final = 10_000
"""Timeout of a handshake, ms."""
ZAP_ADDRESS: Final = "inproc://zeromq.zap.01"
DOMAIN: Final = b"rallyscope"
LOOK_EVERY_MS: Final = 100
NO_MATCH: Final = zmq.Event.HANDSHAKE_FAILED_AUTH | zmq.Event.HANDSHAKE_FAILED_PROTOCOL
HUNG_UP: Final = zmq.Event.HANDSHAKE_FAILED_NO_DETAIL


def check_reach(host: str, keys: ServerKeys | ClientKeys | None, flag: str = "--keys") -> None:
    """Beyond this machine there is no link without keys, which a `flag` names.

    Raises:
        LinkError: if there would be one.
    """
    if keys is None and not is_loopback(host):
        raise LinkError(
            f"{host} is beyond this machine, and what is there needs keys", expected=f"{flag} DIR", remedy=REMEDY
        )


class LinkGateway:
    """Decides, on a thread of its own, which clients a context's guarded sockets accept."""

    def __init__(self, context: zmq.Context, keys: ServerKeys | None) -> None:
        """Without keys every client is accepted, unencrypted: for this machine only."""
        self._keys, self._ended = keys, threading.Event()
        self._thread: threading.Thread | None = None
        if keys is not None:
            socket = context.socket(zmq.REP)
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(ZAP_ADDRESS)
            self._thread = threading.Thread(target=self._run, args=(socket,), name="link-gateway", daemon=True)
            self._thread.start()

    def guard(self, socket: zmq.Socket) -> None:
        """Guard a socket before it is bound."""
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        if self._keys is not None:
            socket.setsockopt(zmq.CURVE_SERVER, 1)
            socket.setsockopt(zmq.CURVE_PUBLICKEY, self._keys.own.public)
            socket.setsockopt(zmq.CURVE_SECRETKEY, self._keys.own.secret)
            socket.setsockopt(zmq.ZAP_DOMAIN, DOMAIN)
            socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without the handler all clients are rejected

    def close(self) -> None:
        """Stop accepting clients; may be called again. Call before the context is destroyed."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, socket: zmq.Socket) -> None:
        try:
            while not self._ended.is_set():
                if socket.poll(LOOK_EVERY_MS):
                    socket.send_multipart(self._verdict(socket.recv_multipart()))
        finally:
            socket.close(0)

    def _verdict(self, request: list[bytes]) -> list[bytes]:
        """The reply of RFC 27 to version, number, domain, address, identity, mechanism and credentials."""
        assert self._keys is not None
        known = (
            len(request) == 7
            and request[2] == DOMAIN
            and request[5] == b"CURVE"
            and len(request[6]) == 32
            and z85.encode(request[6]) in self._keys.clients
        )
        if not known:
            logger.info("somebody without a known key was sent away")
        return [b"1.0", request[1], *([b"200", b"OK"] if known else [b"400", b"unknown key"]), b"", b""]


def secure(socket: zmq.Socket, keys: ClientKeys | None) -> None:
    """Set the keys of a client's socket before it is connected."""
    socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
    if keys is not None:
        socket.setsockopt(zmq.CURVE_SERVERKEY, keys.server)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, keys.own.public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, keys.own.secret)


class HandshakeWatch:
    """Detects failing handshakes of a client; used by the thread of its socket."""

    def __init__(self, socket: zmq.Socket, keys: ClientKeys | None) -> None:
        """Attach to a socket before it is connected."""
        self._watched = socket
        # A server with keys may hang up before it has said that a client without keys does not fit.
        self._monitor = socket.get_monitor_socket(int(NO_MATCH | HUNG_UP))
        self._hung_up = 0

    def refused(self) -> bool:
        """Whether the keys are rejected: by an explicit error or repeated disconnects."""
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            if event & NO_MATCH:
                return True
            self._hung_up += 1
        return self._hung_up > 1

    def close(self) -> None:
        """Detach before the socket is closed."""
        self._watched.disable_monitor()
        self._monitor.close(0)
