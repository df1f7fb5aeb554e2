"""Keys of the link: made, read, refused where they cannot be trusted."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from core.errors import LinkError
from core.live.link.guard import check_reach, make_keys, read_client_keys, read_server_keys, split_address
from core.text import is_loopback


def test_keys_that_were_made_fit_each_other(tmp_path: Path) -> None:
    server, client = make_keys(tmp_path / "keys")
    theirs, ours = read_server_keys(server), read_client_keys(client)
    assert ours.server == theirs.own.public and theirs.clients == {ours.own.public}


def test_making_again_adds_a_client_and_leaves_the_server_as_it_is(tmp_path: Path) -> None:
    server, first = make_keys(tmp_path)
    before = read_server_keys(server).own
    again, second = make_keys(tmp_path)
    assert again == server and second.name == "client-2"
    keys = read_server_keys(server)
    assert keys.own == before
    assert keys.clients == {read_client_keys(folder).own.public for folder in (first, second)}


def test_secret_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    old = os.umask(0)
    try:
        folders = make_keys(tmp_path)
    finally:
        os.umask(old)
    for folder in folders:
        assert stat.S_IMODE((folder / "secret.key").stat().st_mode) == 0o600
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_secret_key_that_others_may_read_is_refused_with_the_remedy(tmp_path: Path) -> None:
    server, client = make_keys(tmp_path)
    for folder, read in ((server, read_server_keys), (client, read_client_keys)):
        (folder / "secret.key").chmod(0o640)
        with pytest.raises(LinkError, match=r"expected mode 600, got 640; chmod 600 "):
            read(folder)


def test_a_secret_is_in_no_text_and_no_error(tmp_path: Path) -> None:
    server, client = make_keys(tmp_path)
    keys = read_server_keys(server)
    secret = keys.own.secret.decode()
    assert secret not in repr(keys) and secret not in repr(read_client_keys(client)) and secret not in str(keys.own)
    (client / "public.key").write_text(secret)  # somebody mixed them up
    with pytest.raises(LinkError) as caught:
        read_client_keys(client)
    assert secret not in str(caught.value)
    (client / "public.key").write_text(secret[:30] + "\x1b[31m")
    with pytest.raises(LinkError) as caught:
        read_client_keys(client)
    assert secret[:30] not in str(caught.value)


@pytest.mark.parametrize("damage", [b"", b"short", b"x" * 10_000_000, b"\x00" * 40, "ä".encode() * 20])
def test_what_is_no_key_is_said_in_one_line(tmp_path: Path, damage: bytes) -> None:
    server, client = make_keys(tmp_path)
    (client / "server.key").write_bytes(damage)
    with pytest.raises(LinkError, match=r"server\.key: not a key"):
        read_client_keys(client)
    (server / "clients" / "client.key").write_bytes(damage)
    with pytest.raises(LinkError, match=r"client\.key: not a key"):
        read_server_keys(server)


def test_a_server_that_would_let_nobody_in_is_refused(tmp_path: Path) -> None:
    server, _ = make_keys(tmp_path)
    (server / "clients" / "client.key").unlink()
    with pytest.raises(LinkError, match="no public keys of clients"):
        read_server_keys(server)


def test_a_folder_without_keys_says_how_to_make_some(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="--make-keys"):
        read_client_keys(tmp_path)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "localhost", "LOCALHOST", "[::1]", "::1"])
def test_this_machine_needs_no_keys(host: str) -> None:
    assert is_loopback(host)
    check_reach(host, None)


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "*", "192.168.1.4", "[::]", "eth0", "127.0.0.1.example.org", "1", "localhost."]
)
def test_all_else_needs_them(host: str) -> None:
    assert not is_loopback(host)
    with pytest.raises(LinkError, match="needs keys; expected --keys DIR"):
        check_reach(host, None)


@pytest.mark.parametrize(
    "address", ["tcp://h:", "tcp://:5", "tcp://h:٣", "tcp://h:65535", "ipc://x", "tcp://h:1" + "0" * 5000]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(LinkError, match="tcp://HOST:PORT"):
        split_address(address)
