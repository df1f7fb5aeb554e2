"""Tune shows the window's events in space and time, where one method is shown."""

from dataclasses import replace

import pytest

from app.client_session.view_link import commands_of, link_of, values_of
from app.modes.tune.commands import SetSpaceColour, ShowEventsInSpace
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import SetSideBySide
from core.detection import DetectorConfig


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


def test_events_are_shown_in_space_until_methods_are_compared_side_by_side(state) -> None:
    assert not state.tune.shows_space
    shown = ShowEventsInSpace(True).apply(state, 0.0)
    assert shown.tune.shows_space
    beside = SetSideBySide(True).apply(shown, 0.0)
    assert not beside.tune.shows_space, "compared methods are pictures"
    assert SetSideBySide(False).apply(beside, 0.0).tune.shows_space


def test_a_colour_that_is_not_offered_changes_nothing(state) -> None:
    assert SetSpaceColour("verdict").apply(state, 0.0).tune.space_colour == "verdict"
    assert SetSpaceColour("height").apply(state, 0.0) == state  # type: ignore[arg-type]


def test_a_link_keeps_the_view_in_space_and_its_colour(state) -> None:
    tune = replace(state.tune, in_space=True, space_colour="verdict")
    linked = values_of(link_of(replace(state, tune=tune), 0))
    found = state
    for command in commands_of(linked, state):
        found = command.apply(found, 0.0)
    assert found.tune == tune
