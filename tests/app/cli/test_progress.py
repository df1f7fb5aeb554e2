"""Long work says how far it is, in a terminal and where there is none."""

import itertools
import os
import pty
import sys
import termios
from types import SimpleNamespace

import pytest

from app.cli import progress
from app.cli.progress import progress_bar, progress_line
from tests.waiting import eventually


def test_without_a_terminal_work_that_lasts_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "QUIET_S", 0.05)
    monkeypatch.setattr(progress, "SAY_EVERY_S", 0.05)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: 7.0))  # however late the lines are said
    with progress_bar("Measuring simulation") as show:
        said = read_until(capsys, "so far")  # nothing is known yet, and yet it says something
        show(0.25)
        later = read_until(capsys, " left")
    assert said.splitlines()[0] == "Measuring simulation: 0 s so far"
    assert later.splitlines()[-1].startswith("Measuring simulation: 25 %, about ") and later.endswith(" left\n")


def read_until(capsys: pytest.CaptureFixture[str], there: str) -> str:
    """What was said on standard error until these words were among it."""
    said: list[str] = []

    def heard() -> str:
        said.append(capsys.readouterr().err)
        text = "".join(said)
        return text if there in text and text.endswith("\n") else ""

    return eventually(heard, f"{there!r} to be said", lambda: said)


def test_what_is_done_soon_says_nothing_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("Importing") as show:
        show(0.5)
    assert capsys.readouterr().err == ""


def test_a_line_that_is_to_stay_is_said_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("Measuring") as show:
        show.say("scene ball, ratio 1.5")
        assert capsys.readouterr().err == "scene ball, ratio 1.5\n"


def test_a_terminal_has_a_bar_and_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    mine, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    with os.fdopen(theirs, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        seconds = itertools.count()  # a bar is drawn again only after a while
        monkeypatch.setattr("tqdm.std.time", lambda: float(next(seconds)))
        with progress_bar("Tracking") as show:
            show(0.5)
            show.say("half of it")
        seen = ""
        while "half of it" not in seen:
            seen += os.read(mine, 10_000).decode()
    os.close(mine)
    assert "Tracking" in seen and "50%" in seen and "left" in seen and "half of it" in seen


@pytest.mark.parametrize(
    ("share", "spent_s", "line"),
    [
        (0.0, 42.0, "Tuning: 42 s so far"),
        (0.5, 60.0, "Tuning: 50 %, about 60 s left"),
        (0.25, 100.0, "Tuning: 25 %, about 5 min left"),
        (0.01, 100.0, "Tuning: 1 %, about 2.8 h left"),
    ],
)
def test_time_left_is_in_words(share: float, spent_s: float, line: str) -> None:
    assert progress_line("Tuning", share, spent_s) == line
