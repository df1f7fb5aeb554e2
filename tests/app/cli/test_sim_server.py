"""`rallyscope sim-server`: bad arguments and busy ports end in one clear line."""

from __future__ import annotations

import pytest
import zmq

from app.cli import main


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bind", "nonsense"], "tcp://HOST:PORT"),
        (["--bind", "tcp://127.0.0.1:99999"], "tcp://HOST:PORT"),
        (["--bind", "ipc:///tmp/x"], "tcp://HOST:PORT"),
        (["--noise-hz", "500"], "--noise-hz"),
        (["--auto-serve", "1"], "3 to 9 m/s"),
        (["--seed", "-1"], "no such seed"),
        (["--physics", "moon"], "invalid choice"),
        (["--cameras", "nowhere"], "no such cameras"),
        (["--ball-states", "no-such.json"], "no-such.json"),
        (["--ball-states", __file__], "not JSON"),
        (["--bind", "tcp://0.0.0.0:0"], "needs keys; expected --keys DIR; make keys with"),
        (["--bind", "tcp://*:5555"], "needs keys"),
        (["--keys", "no-such-folder"], "--make-keys"),
    ],
)
def test_a_bad_argument_is_one_line_and_exit_code_2(arguments, words, capsys):
    assert main(["sim-server", "--sensor", "64x48", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


def test_a_busy_port_is_one_line_that_says_what_to_do(capsys):
    with zmq.Context() as context, context.socket(zmq.PUB) as taken:
        port = taken.bind_to_random_port("tcp://127.0.0.1", max_port=60000)
        assert main(["sim-server", "--sensor", "64x48", "--bind", f"tcp://127.0.0.1:{port}"]) == 2
    error = capsys.readouterr().err
    assert "choose others" in error and error.count("\n") == 1


def test_keys_are_made_with_a_word_on_what_to_do_with_them(tmp_path, capsys):
    assert main(["sim-server", "--make-keys", str(tmp_path / "keys")]) == 0
    said = capsys.readouterr().out
    assert f"--keys {tmp_path / 'keys' / 'server'}" in said and "serve --source" in said
    for name in ("server", "client"):
        secret = (tmp_path / "keys" / name / "secret.key").read_text().strip()
        assert len(secret) == 40 and secret not in said
