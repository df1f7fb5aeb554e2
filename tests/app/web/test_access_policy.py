"""Who may come in: rules alone, without a server."""

import pytest

from app.web.access_policy import Admission, RequestOrigin, make_token
from core.errors import CommandError

TOKEN = "abcdefghijklmnopqrstuvwx"


def caller(host: str | None = "127.0.0.1:8080", origin: str | None = None, **more) -> RequestOrigin:
    return RequestOrigin(
        host=host, origin=origin, has_origin=origin is not None, **{"cookie": None, "token": None, **more}
    )


@pytest.mark.parametrize("host", ["localhost", "localhost:8080", "127.0.0.1:1", "[::1]:8080", "LocalHost:9000"])
def test_this_machine_comes_in_at_any_port(host: str) -> None:
    assert Admission().judge(caller(host)) == "come in"
    assert Admission().judge(caller(host, f"http://{host}")) == "come in"


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "evil.example",
        "evil.example:8080",
        "127.0.0.1.evil.example",
        "localhost.evil.example:8080",
        "localhost@evil.example",
        "evil.example#localhost",
        "127.0.0.1:8080:9090",
        "127.0.0.1:",
        "127.0.0.1:8080\n",
        "[::1",
        "0.0.0.0:8080",
        "192.168.1.5:8080",
        "2130706433",
    ],
)
def test_any_other_host_is_refused(host: str | None) -> None:
    assert Admission().judge(caller(host)) == "wrong host"


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://127.0.0.1:3000",  # another server of this machine
        "http://localhost:8080",  # as Host it would do, but the page came from elsewhere
        "http://127.0.0.1:8080.evil.example",
        "file://",
        "ftp://127.0.0.1:8080",
    ],
)
def test_a_page_of_another_origin_is_refused(origin: str) -> None:
    assert Admission().judge(caller("127.0.0.1:8080", origin)) == "wrong origin"


def test_an_origin_that_is_said_twice_is_refused() -> None:
    twice = RequestOrigin(host="127.0.0.1:8080", origin=None, has_origin=True, cookie=None, token=None)
    assert Admission().judge(twice) == "wrong origin"


@pytest.mark.parametrize("local", [True, False])
def test_a_token_is_asked_for_and_taken_from_the_link_or_as_the_cookie(local: bool) -> None:
    admission = Admission(local, TOKEN)
    assert admission.judge(caller()) == "needs token"
    assert admission.judge(caller(token=TOKEN)) == "come in"
    assert admission.judge(caller(cookie=admission.cookie)) == "come in"
    for wrong in ("", TOKEN[:-1], TOKEN + "x", TOKEN.upper(), admission.cookie, "ä" * 24, "\ud800"):
        assert admission.judge(caller(token=wrong)) == "needs token"
    assert admission.judge(caller(cookie=TOKEN)) == "needs token"
    assert admission.judge(caller(cookie=Admission(local, make_token()).cookie)) == "needs token"


def test_beyond_this_machine_any_name_is_right_but_its_page_must_be_its_own() -> None:
    admission = Admission.of_address("0.0.0.0", None)
    assert admission.token is not None and not admission.local
    lab = "lab-7.example:8080"
    assert admission.judge(caller(lab, token=admission.token)) == "come in"
    assert admission.judge(caller(lab, f"http://{lab}", token=admission.token)) == "come in"
    assert admission.judge(caller(lab, "http://evil.example", token=admission.token)) == "wrong origin"
    assert admission.judge(caller("a b", token=admission.token)) == "wrong host"
    assert admission.judge(caller(lab)) == "needs token"


def test_what_moves_machines_asks_for_a_token_on_this_machine_too() -> None:
    admission = Admission.of_address("127.0.0.1", None, moves_machines=True)
    assert admission.local and admission.token is not None
    assert admission.judge(caller()) == "needs token"
    assert admission.judge(caller(token=admission.token)) == "come in"
    assert Admission.of_address("127.0.0.1", "a-token-of-my-own", moves_machines=True).token == "a-token-of-my-own"


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_on_this_machine_no_token_is_needed(host: str) -> None:
    assert Admission.of_address(host, None) == Admission(True, None)


@pytest.mark.parametrize("token", ["", "short", "with space in the middle", "a&b=c" * 5, "ä" * 20, "a\nb" * 10])
def test_a_token_that_can_be_guessed_or_breaks_a_link_is_refused(token: str) -> None:
    with pytest.raises(CommandError, match="not a usable token"):
        Admission.of_address("127.0.0.1", token)


def test_tokens_differ_and_are_long() -> None:
    tokens = {make_token() for _ in range(50)}
    assert len(tokens) == 50 and min(map(len, tokens)) >= 32
