"""What the page is told and may ask for."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.panels.time_bar import (
    FAR_US,
    MOST,
    ContactMark,
    Runs,
    TimeBar,
    Tracks,
    bar_message,
    command_of,
    runs_of_times,
    runs_of_verdicts,
    speed_label,
    step_label,
    tracks_message,
)
from app.state.client_state import ClientState, Configs, History, Playhead
from core.detection import DetectorConfig
from core.metrics import WindowVerdicts


def state(**playhead) -> ClientState:
    configs = Configs(DetectorConfig(), DetectorConfig())
    return ClientState("demo", ("left",), "left", Playhead(2_000_000, **playhead), History(configs))


def test_a_line_is_added_to_those_that_are_there_and_moments_grow_once_a_second(monkeypatch) -> None:
    sent, moments = [], {"bounce": np.array([5])}
    page = SimpleNamespace(listen=lambda kind, listener: None, send=lambda kind, values: sent.append(values))
    monkeypatch.setattr("app.panels.time_bar.moments_of", lambda recording: dict(moments))
    bar, runs, mark = (
        TimeBar(page, lambda command: None),
        Runs(*np.zeros((2, 0), int), ()),
        ContactMark(7, 1, "hit", False),
    )
    bar.show_tracks(Tracks(100))
    bar.show_runs("labels", runs)
    bar.show_runs("detector", runs)
    bar.show_contacts((mark,))
    bar.grow(None, 10.0)
    assert (bar.tracks.duration_us, set(bar.tracks.runs), bar.tracks.contacts) == (100, {"labels", "detector"}, (mark,))
    assert len(sent) == 5 and bar.tracks.moments == moments
    bar.grow(None, 11.0)
    assert len(sent) == 5, "there is nothing new"
    moments["bounce"] = np.array([5, 9])
    bar.grow(None, 11.5)
    assert len(sent) == 5, "it is too early to read them again"
    bar.grow(None, 12.0)
    assert len(sent) == 6 and bar.tracks.moments["bounce"].tolist() == [5, 9]


@pytest.mark.parametrize(
    ("message", "position_us"),
    [
        ({"do": "seek", "value": 1_500}, 1_500),
        ({"do": "seek", "value": -5}, 0),
        ({"do": "seek", "value": 1e300}, 2_000_000),
        ({"do": "step", "value": 10}, 10_000),
        ({"do": "step", "value": 10**9}, 1_000_000),
    ],
)
def test_what_the_bar_asks_for_moves_the_cursor(message, position_us) -> None:
    command = command_of(message)
    assert command is not None
    assert command.apply(state(), 1.0).playhead.position_us(1.0) == position_us


def test_the_other_things_that_it_asks_for() -> None:
    def after(**message):
        command = command_of(message)
        assert command is not None, message
        return command.apply(state(), 1.0)

    assert after(do="play").playhead.playing
    assert [after(do="mode", value=number).mode for number in (1, 3, 5)] == ["Watch", "Label", "Export"]
    assert after(do="speed", value=0.25).playhead.speed == 0.25
    assert after(do="step_us", value=500).step_us == 500
    assert after(do="mark", value=700).marks_us == (700,)
    assert after(do="loop", value=[9_000, 4_000]).playhead.loop_us == (4_000, 9_000)
    assert after(do="loop", value=None).playhead.loop_us is None


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"do": "delete"},
        {"do": "seek"},
        {"do": "seek", "value": "1"},
        {"do": "seek", "value": float("nan")},
        {"do": "seek", "value": True},
        {"do": "seek", "value": [1]},
        {"do": "mode", "value": 0},
        {"do": "mode", "value": 6},
        {"do": "mode", "value": "Watch"},
        {"do": "speed", "value": 1e9},
        {"do": "speed", "value": -1},
        {"do": "loop", "value": [1]},
        {"do": "loop", "value": [1, "x"]},
        {"do": "loop", "value": {"a": 1}},
        {"do": ["seek"], "value": 1},
    ],
)
def test_nonsense_asks_for_nothing(message) -> None:
    assert command_of(message) is None


def test_what_the_page_is_told_is_json_and_says_where_the_cursor_is() -> None:
    message = bar_message(state(), 5, visible=True, keys=True)
    assert json.loads(json.dumps(message)) == message
    assert (message["now"], message["start"], message["end"], message["playing"]) == (5, 0, 2_000_000, False)


def test_the_line_of_a_live_recording_spans_what_it_remembers() -> None:
    long = replace(state(live=True), playhead=Playhead(50_000_000, live=True, following=True, start_us=29_000_000))
    message = bar_message(long, 50_000_000, visible=True, keys=True)
    assert (message["start"], message["end"]) == (30_000_000, 50_000_000)


def test_rates_are_shares_of_the_highest_of_all_cameras() -> None:
    tracks = Tracks(10, {"a": np.array([0.0, 5.0]), "b": np.array([10.0, 2.5])})
    message = tracks_message(tracks)
    assert message["rates"] == {"a": [0, 128], "b": [255, 64]} and message["top_hz"] == 10.0
    assert json.dumps(tracks_message(Tracks(0)))


def test_no_more_is_sent_than_can_be_seen() -> None:
    many = np.arange(100_001, dtype=np.int64)
    runs = Runs(many, many + 1, ("missed",) * len(many))
    message = tracks_message(Tracks(200_000, {}, {"bounce": many}, {"detector": runs}))
    assert len(message["moments"]["bounce"]) <= MOST and len(message["runs"]["detector"]) <= MOST  # type: ignore[index]


def test_times_of_one_kind_are_joined() -> None:
    t_us, kinds = np.array([0, 10, 20, 30, 100, 110]), np.array([0, 0, 1, 1, 1, 0])
    runs = runs_of_times(t_us, kinds, ("found", "missed"), 10)
    assert runs.start_us.tolist() == [0, 20, 100, 110]
    assert runs.end_us.tolist() == [20, 40, 110, 120]
    assert runs.kinds == ("found", "missed", "missed", "found")
    assert runs_of_times(t_us[:0], kinds[:0], ("a",), 10).kinds == ()


def test_words() -> None:
    assert [step_label(step) for step in (1, 500, 2_000, 1_000_000)] == ["1 µs", "500 µs", "2 ms", "1 s"]
    assert [speed_label(speed) for speed in (0.05, 1.0, 2.0)] == ["1/20 x", "1 x", "2 x"]
    assert FAR_US < 2**53  # a whole number in the page's script, too


def test_verdicts_of_windows_become_stretches_round_their_times() -> None:
    yes, no = np.array([True, True, False, False, False]), np.zeros(5, np.bool_)
    false = np.array([False, False, False, True, False])
    t_us = np.array([500, 1_500, 2_500, 3_500, 4_500])
    with_ball = np.array([True, True, True, False, False])
    verdicts = WindowVerdicts(t_us, np.ones(5, np.bool_), with_ball, yes, false, no.astype(float))
    runs = runs_of_verdicts(verdicts, 1_000)
    assert runs.kinds == ("found", "missed", "false")  # and nothing where there is no ball and no answer
    assert runs.start_us.tolist() == [0, 2_000, 3_000] and runs.end_us.tolist() == [2_000, 3_000, 4_000]
