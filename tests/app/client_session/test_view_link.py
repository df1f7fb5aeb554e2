"""Links: what they say leads back to the same view, and a bad one does nothing."""

from dataclasses import replace

import numpy as np
import pytest

from app.client_session.view_link import MAX_LENGTH, commands_of, link_of, values_of
from app.modes.label.kept_view import KeepLabelChoices
from app.modes.watch.commands import EnlargeCamera, ShowLayer, ShowSpace
from app.scene.world import LAYERS
from app.state import commands
from app.state.client_state import ClientState, Configs, History, Playhead
from core.config import field_specs
from core.detection import DetectorConfig
from core.errors import ConfigError


def fresh(**playhead) -> ClientState:
    configs = Configs(DetectorConfig(), DetectorConfig())
    head = Playhead(2_000_000, **playhead)
    return ClientState("demo", ("left", "right"), "left", head, History(configs))


def followed(link: str, state: ClientState | None = None) -> ClientState:
    state = state or fresh()
    for command in commands_of(values_of(link), state):
        state = command.apply(state, 5.0)
    return state


def used() -> ClientState:
    state = fresh()
    for command in (
        commands.SetMode("Tune"),
        commands.SetCamera("right"),
        commands.SetPlaybackSpeed(0.01),
        commands.StopAt(123_456),
        commands.SetStep(500),
        commands.SetWindow(7_000),
        commands.SetArrangement("stacked"),
        commands.SetOverlay("clusters"),
        commands.SetZoom(6.5),
        commands.LookAt((321.5, 99.5)),
        commands.SetSlot("B"),
        commands.EditSetting(("geometry", "circularity_min"), 0.5),
        commands.SetSlot("A"),
        commands.EditSetting(("cluster", "eps_px"), 4.0),
        commands.SetCompare(True),
        commands.ShowTruth(False),
        ShowSpace(False),
        ShowLayer(LAYERS[0], on=False),
        EnlargeCamera("right"),
        commands.ToggleMark(77_000),
        KeepLabelChoices(5.0, "bea in others/one & two.sqlite", True),
        commands.Loop((100_000, 200_000)),
    ):
        state = command.apply(state, 5.0)
    return state


def test_a_link_leads_to_the_same_view_and_settings() -> None:
    state = used()
    there = followed(link_of(state, state.playhead.position_us(5.0)))
    assert there.configs.present == state.configs.present
    for name in ("recording", "camera", "mode", "step_us", "look", "tune", "watch", "label", "marks_us"):
        assert getattr(there, name) == getattr(state, name), name
    assert there.playhead.loop_us == (100_000, 200_000)
    assert there.playhead.position_us(9.0) == 123_456 and there.playhead.speed == 0.01


def test_of_a_method_with_settings_of_its_own_too() -> None:
    state = commands.SetMethod("ebpp").apply(fresh(), 5.0)
    spec = next(spec for spec in field_specs(DetectorConfig) if spec.path[0] == "ebpp" and spec.bounds is not None)
    assert spec.bounds is not None
    state = commands.EditSetting(spec.path, spec.kind(spec.bounds.low)).apply(state, 5.0)
    there = followed(link_of(state, 0))
    assert there.tune.method == "ebpp" and there.config == state.config and there.configs == fresh().configs


def test_what_is_as_usual_is_left_out_of_a_short_link() -> None:
    assert link_of(fresh(), 0) == "v=1&recording=demo&t=0&speed=0.05&method=refined"
    assert "t=" not in link_of(fresh(live=True, following=True), 1_999_000)


def test_a_link_without_a_method_is_of_the_one_that_was_usual_when_it_was_made() -> None:
    there = followed("v=1&recording=demo&mode=Tune&t=0&speed=0.05&a.cluster.eps_px=4.0")
    assert there.tune.method == "auto" and there.config.cluster.eps_px == 4.0
    assert followed(link_of(there, 0)).tune.method == "auto"
    assert followed("mode=Tune").tune.method == "refined", "written by hand: nothing is said of a detector"


def test_a_followed_link_is_one_step_that_can_be_undone() -> None:
    mine = commands.EditSetting(("cluster", "eps_px"), 7.0).apply(fresh(), 1.0)
    there = followed(link_of(used(), 0), mine)
    assert there.configs.present == used().configs.present
    assert commands.Undo().apply(there, 6.0).configs.present == mine.configs.present


@pytest.mark.parametrize(
    "link",
    [
        "",
        "no link",
        "&&&==&",
        "mode=Hack&camera=../../etc&t=nan&speed=-1&zoom=inf&at=1&stage=x&method=rm&slot=Z&label_zoom=3",
        "v=1&a.cluster.eps_px=1e999",
        "v=1&a.no.such=1",
        "v=1&a.cluster.eps_px=[[[",
        'v=1&a.cluster.eps_px="text"',
        "v=1&b.window.window_us=-5",
        "v=1&a.cluster.eps_px=" + "[" * 3000,
        "t=" + "9" * 3900,
        "x" * (MAX_LENGTH + 1),
        "<script>alert(1)</script>",
    ],
)
def test_a_bad_link_changes_nothing(link: str) -> None:
    there = followed(link)
    assert there.configs.present == fresh().configs.present
    assert replace(there, playhead=fresh().playhead) == fresh()
    assert 0 <= there.playhead.position_us(5.0) <= 2_000_000 and there.playhead.speed > 0


def test_any_damage_to_a_link_leaves_a_state_that_can_be_shown() -> None:
    rng = np.random.default_rng(3)
    good = link_of(used(), 123_456)
    for _ in range(400):
        letters = list(good)
        for at in rng.integers(0, len(letters), rng.integers(1, 6)):
            letters[at] = chr(rng.integers(32, 127))
        there = followed("".join(letters))
        assert link_of(there, there.playhead.position_us(5.0))
        assert there.camera in there.cameras and 1.0 <= there.tune.zoom <= 20.0


def test_a_link_with_too_many_settings_still_shows_the_view() -> None:
    state = fresh()
    rng = np.random.default_rng(0)
    for slot in ("A", "B"):
        state = commands.SetSlot(slot).apply(state, 0.0)
        for spec in field_specs(DetectorConfig):
            if spec.bounds is not None and spec.kind is float:
                value = float(rng.uniform(spec.bounds.low, spec.bounds.high))
                try:
                    state = commands.EditSetting(spec.path, value).apply(state, 0.0)
                except ConfigError:  # it does not go with the others
                    continue
    link = link_of(commands.SetMode("Tune").apply(state, 0.0), 5)
    assert len(link) <= MAX_LENGTH and followed(link).mode == "Tune"
