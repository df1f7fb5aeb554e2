"""Access policy: rules for a request's Host, Origin and token. Pure; knows no server.

Any page that is open in a browser may send requests to this machine's ports, and a name that an attacker owns may
point to 127.0.0.1 (DNS rebinding). So a request must name this machine as its Host, and where it says which page it
comes from (Origin; browsers always do for websockets), that page must be our own.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import socket
from dataclasses import dataclass
from typing import Final, Literal

from core.errors import CommandError

LOCAL_HOSTS: Final = ("127.0.0.1", "localhost", "::1")
TOKEN_COOKIE: Final = "rallyscope-token"
MIN_TOKEN_LENGTH: Final = 16
_LOCAL: Final = re.compile(r"(localhost|127\.0\.0\.1|\[::1\])(:\d{1,5})?", re.IGNORECASE)
_HOST: Final = re.compile(r"([a-z0-9._-]{1,253}|\[[0-9a-f:.]{2,45}\])(:\d{1,5})?", re.IGNORECASE)
_TOKEN: Final = re.compile(r"[A-Za-z0-9._~-]+")

Verdict = Literal["come in", "wrong host", "wrong origin", "needs token"]


@dataclass(frozen=True, slots=True)
class RequestOrigin:
    """Headers of a request; each is None if it is missing or given twice."""

    host: str | None
    origin: str | None
    has_origin: bool
    cookie: str | None
    """Our cookie, set by the gateway when it saw the token."""
    token: str | None
    """Token from the link, or from the Authorization header."""


@dataclass(frozen=True, slots=True)
class Admission:
    """The rules of one server."""

    local: bool = True
    """Whether the app listens on this machine only."""
    token: str | None = None
    """Required token; None if none is needed."""

    def __post_init__(self) -> None:
        if not self.local and self.token is None:
            raise CommandError("no token", expected="one, where other machines can connect", where="--token")
        if self.token is not None and (len(self.token) < MIN_TOKEN_LENGTH or not _TOKEN.fullmatch(self.token)):
            raise CommandError(
                "not a usable token",
                expected=f"at least {MIN_TOKEN_LENGTH} letters, digits, '-', '_', '.' or '~'",
                got=f"{len(self.token)} characters",
                where="--token",
            )

    @classmethod
    def of_address(cls, host: str, token: str | None, *, moves_machines: bool = False) -> Admission:
        """The rules of a server that listens on `host`; beyond this machine it gets a token if it has none.

        On this machine, too, if it `moves_machines`: other users of it could start the robot, or use the cameras.

        Raises:
            CommandError: if the token is too short or could not stand in a link.
        """
        local = host in LOCAL_HOSTS
        return cls(local, make_token() if token is None and (moves_machines or not local) else token)

    def judge(self, caller: RequestOrigin) -> Verdict:
        """Whether a request is admitted, and if not, why."""
        allowed = _LOCAL if self.local else _HOST
        if caller.host is None or not allowed.fullmatch(caller.host):
            return "wrong host"
        if caller.has_origin and not _is_origin_of(caller.host, caller.origin):
            return "wrong origin"
        if self.token is not None and not self.is_token(caller.token) and not self._is_cookie(caller.cookie):
            return "needs token"
        return "come in"

    def is_token(self, text: str | None) -> bool:
        """Whether this is the token, compared in constant time."""
        return self.token is not None and text is not None and _equal(text, self.token)

    @property
    def cookie(self) -> str:
        """Cookie that the browser keeps instead of the token."""
        assert self.token is not None
        return hmac.new(self.token.encode(), b"rallyscope cookie", hashlib.sha256).hexdigest()

    def _is_cookie(self, text: str | None) -> bool:
        return text is not None and _equal(text, self.cookie)


def make_token() -> str:
    """New random token of 192 bits."""
    return secrets.token_urlsafe(24)


def _is_origin_of(host: str, origin: str | None) -> bool:
    return origin is not None and origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "replace"), other.encode())


def check_address(host: str, port: int) -> None:
    """Try to listen for a moment; port 0 stands for any free one.

    Raises:
        CommandError: if the address cannot be used.
    """
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError, TypeError, UnicodeError) as error:  # the last two over names that are no text
        raise port_taken(host, port, str(error)) from error


def port_taken(host: str, port: int, reason: str) -> CommandError:
    """Error message for an address that cannot be listened on."""
    remedy = "it may run there already: open it in a browser, or choose another with --port or --host"
    return CommandError(f"cannot listen on {host}:{port}", got=reason, remedy=remedy)
