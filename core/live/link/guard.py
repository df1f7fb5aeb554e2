"""Encrypted sockets, and the access control for known clients (ZMQ's ZAP, RFC 27)."""

from __future__ import annotations

import logging
import threading
from typing import Final

import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from core.errors import LinkError
from core.live.link.keys import REMEDY, ClientKeys, ServerKeys
from core.text.host import is_loopback

logger = logging.getLogger(__name__)

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
            self._thread = threading.Thread(target=self._run, args=(socket,), name="link-door", daemon=True)
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
        self._monitor = socket.get_monitor_socket(int(NO_MATCH | (HUNG_UP if keys is not None else 0)))
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
