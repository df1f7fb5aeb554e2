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
        (["--noise-hz", "500"], "noise_hz"),
        (["--auto-serve", "1"], "3 to 9 m/s"),
        (["--seed", "-1"], "no such seed"),
        (["--physics", "moon"], "invalid choice"),
        (["--cameras", "nowhere"], "no such cameras"),
        (["--ball-states", "no-such.json"], "no-such.json"),
        (["--ball-states", __file__], "not JSON"),
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
