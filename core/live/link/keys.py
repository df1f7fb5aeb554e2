"""Keys of the simulation link (CURVE), for authentication of clients and server.

A folder of keys holds `public.key` and `secret.key`, its owner's pair, and of a server `clients/NAME.key`, the public
keys that it lets in; of a client `server.key`, the public key that the server must have. A key is 40 characters (Z85).
"""

from __future__ import annotations

import itertools
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import zmq
from zmq.utils import z85

from core.errors import LinkError
from core.files import BINARY, POSIX

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
        names = itertools.chain(["client"], (f"client-{number}" for number in itertools.count(2)))
        client = folder / next(name for name in names if not (folder / name).exists())
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
