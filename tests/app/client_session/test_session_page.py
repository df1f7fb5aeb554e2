"""A page that the processor draws is shown a live rally a few times a second, and what was asked for at once."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.client_session.session_page import FEW_EVERY_S, FrameThrottle, SessionPage, opened_view
from app.shared.workspace import Workspace
from app.state.browser_memory import BrowserMemory
from app.state.client_state import ClientState, Configs, History, Playhead, TuneView
from app.state.commands import Command, Seek, SetMode
from app.web.pages import Message, PageConnection
from core.detection import DetectorConfig

LIVE = Playhead(600_000, live=True, following=True, playing=True, speed=1.0)


def state_of(head: Playhead = LIVE) -> ClientState:
    return ClientState("live", ("left", "right"), "left", head, History(Configs(DetectorConfig(), DetectorConfig())))


def turns(pace: FrameThrottle, state: ClientState | None, seconds: float = 10.0) -> int:
    """How many of 60 turns a second are due."""
    return sum(pace.is_due(state, number / 60) for number in range(round(60 * seconds)))


def test_a_page_that_the_processor_draws_gets_few_pictures_of_a_live_rally() -> None:
    pace = FrameThrottle()
    pace.hear({"software": True})
    assert turns(pace, state_of()) == pytest.approx(10 / FEW_EVERY_S, rel=0.1)


@pytest.mark.parametrize("message", [{"software": False}, {}, {"software": "yes"}, {"software": [1]}])
def test_another_page_gets_every_picture(message: dict[str, object]) -> None:
    pace = FrameThrottle()
    pace.hear(message)
    assert turns(pace, state_of(), 2) == 120


@pytest.mark.parametrize(
    "head", [replace(LIVE, playing=False, following=False), replace(LIVE, live=False, following=False)]
)
def test_what_stands_still_and_a_recording_are_not_slowed(head: Playhead) -> None:
    pace = FrameThrottle()
    pace.hear({"software": True})
    assert turns(pace, state_of(head), 2) == turns(pace, None, 2) == 120


def test_only_a_live_rally_that_the_processor_draws_is_spared() -> None:
    pace = FrameThrottle()
    assert not pace.throttles(state_of())
    pace.hear({"software": True})
    assert pace.throttles(state_of()) and not pace.throttles(None)
    assert not pace.throttles(state_of(replace(LIVE, playing=False, following=False)))


def test_who_asks_for_something_does_not_wait() -> None:
    pace = FrameThrottle()
    pace.hear({"software": True})
    assert pace.is_due(state_of(), 1.0) and not pace.is_due(state_of(), 1.05)
    pace.request_frame()
    assert pace.is_due(state_of(), 1.06) and not pace.is_due(state_of(), 1.08)
    assert pace.is_due(state_of(), 1.07 + FEW_EVERY_S)


@pytest.mark.parametrize(("share", "pictures"), [(1.0, 50), (0.5, 25), (1 / 3, 17), (1 / 16, 17)])
def test_a_rally_that_cannot_keep_up_is_shown_as_often_in_each_of_its_seconds(share: float, pictures: int) -> None:
    pace = FrameThrottle()
    pace.hear({"software": True})
    pace.hear_pace(share)
    assert turns(pace, state_of()) == pytest.approx(pictures, rel=0.1)


def test_back_changes_the_mode_before_what_was_asked_for_after_it(tmp_path: Path) -> None:
    inbox: list[Callable[[], None]] = []
    done: list[Command] = []
    heard: list[Callable[[Message], None]] = []
    pages = SimpleNamespace(open=lambda page, listen: heard.append(listen))
    session = SimpleNamespace(state=state_of(), later=inbox.append, apply=done.append)
    session.send = lambda command: inbox.append(lambda: done.append(command))
    with ThreadPoolExecutor(1) as pool:
        SessionPage(PageConnection("page"), pages, BrowserMemory(Workspace(tmp_path)), pool, session)
        heard[0]({"type": "go_to_link", "link": "mode=Label"})
        session.send(Seek(1))
        while inbox:
            inbox.pop(0)()
    assert done == [SetMode("Label"), Seek(1)]


def test_tune_shows_the_whole_sensor_of_another_recording_unless_its_ball_is_known() -> None:
    before = TuneView(zoom=6.0, centre_px=(3.0, 4.0), method="ebpp")
    assert opened_view(before, has_ball=True) == TuneView(zoom=6.0, method="ebpp")
    assert opened_view(before, has_ball=False) == TuneView(zoom=1.0, method="ebpp")
