"""Event pictures are asked for when what they show changes, and shown while they are to be seen."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from app.client_session import event_pictures
from app.client_session.event_pictures import EventPictures
from app.state.client_state import ClientState, Configs, History, Playhead
from core.detection import DetectorConfig


class Desk:
    """Draws at once, and notes what is asked for, shown, and failed."""

    def __init__(self) -> None:
        self.asked, self.shown, self.failed, self.is_wanted = [], [], [], True
        self.why_not = []
        freshness = SimpleNamespace(ask=lambda request, wall_s: None, failed=lambda: self.failed.append("late"))
        plane = SimpleNamespace(free_aspect=1.5, freshness=freshness, show=lambda sheet, _: self.shown.append(sheet))
        pool = SimpleNamespace(submit=lambda work: work())
        self.pictures = EventPictures(pool, plane, lambda act: act(), self.failed.append, lambda: self.is_wanted)
        configs = Configs(DetectorConfig(), DetectorConfig())
        self.state = ClientState("demo", ("left",), "left", Playhead(2_000_000), History(configs))

    def ask(self, now_us: int) -> None:
        self.pictures.ask(self.state, SimpleNamespace(uuid="demo"), now_us, 0.0)


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Desk:
    def render(request) -> str:
        desk.asked.append(request.t_us)
        desk.why_not.append(request.why_not)
        if request.t_us < 0:
            raise ValueError("no picture")
        return f"at {request.t_us}"

    monkeypatch.setattr(event_pictures, "render_watch", render)
    desk = Desk()
    return desk


def test_the_same_pictures_are_drawn_once_until_something_else_was_shown(desk: Desk) -> None:
    for now_us in (10, 10, 20):
        desk.ask(now_us)
    desk.pictures.forget()
    desk.ask(20)
    assert desk.asked == [10, 20, 20] and desk.shown == ["at 10", "at 20", "at 20"]


def test_a_picture_that_comes_after_a_change_of_mode_is_not_shown(desk: Desk) -> None:
    desk.is_wanted = False
    desk.ask(10)
    assert desk.asked == [10] and not desk.shown


def test_why_there_is_no_ball_is_asked_in_watch_while_the_picture_stands(desk: Desk) -> None:
    standing, playing = Playhead(2_000_000), Playhead(2_000_000, playing=True)
    for mode, playhead in (("Watch", standing), ("Watch", playing), ("Label", standing)):
        desk.state = replace(desk.state, mode=mode, playhead=playhead)
        desk.ask(10)
    assert desk.why_not == [True, False, False]


def test_a_picture_that_cannot_be_drawn_is_late_and_reported(desk: Desk) -> None:
    desk.ask(-1)
    assert desk.failed[0] == "late" and isinstance(desk.failed[1], ValueError) and not desk.shown
