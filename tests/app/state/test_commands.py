from dataclasses import replace

import pytest

from app.state import commands as c
from app.state.client_state import ClientState, Configs, History, PickedPoint, Playhead
from core.config import get_setting, replace_setting
from core.detection import DetectorConfig, ebpp_config, refined_config
from core.errors import ConfigError


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


@pytest.mark.parametrize(
    "command",
    [
        c.SetMode("Hack"),
        c.SetRendering("<b>"),
        c.SetColours("none"),
        c.SetArrangement("spiral"),
        c.SetOverlay(""),
        c.SetSlot("C"),
        c.SetMethod("yolo"),
        c.SetZoom(float("nan")),
        c.LookAt((float("inf"), 0.0)),
        c.PickCluster(PickedPoint("left", 0, (float("nan"), 0.0))),
        c.SetStep(7),
        c.SetPlaybackSpeed(-1.0),
        c.SetCamera("../x"),
    ],
)
def test_a_value_no_control_offers_changes_nothing(state: ClientState, command: c.Command) -> None:
    assert command.apply(state, 0.0) == state


def test_numbers_are_kept_in_their_ranges(state: ClientState) -> None:
    assert c.SetWindow(10**9).apply(state, 0.0).look.window_us == c.WINDOW_RANGE_US[1]
    assert c.SetWindow(-5).apply(state, 0.0).look.window_us == c.WINDOW_RANGE_US[0]
    assert c.SetZoom(1e9).apply(state, 0.0).tune.zoom == c.ZOOM_RANGE[1]
    assert c.Seek(2**80).apply(state, 0.0).playhead.position_us(0.0) == 1_000_000


def test_steps_go_by_the_chosen_step(state: ClientState) -> None:
    state = c.SetStep(2_000).apply(state, 0.0)
    assert c.StepTime(3).apply(state, 0.0).playhead.position_us(0.0) == 6_000


def test_play_toggles(state: ClientState) -> None:
    playing = c.TogglePlay().apply(state, 1.0)
    assert playing.playhead.playing and not c.TogglePlay().apply(playing, 2.0).playhead.playing


def test_a_slider_changes_only_the_config_that_is_edited(state: ClientState) -> None:
    path = ("cluster", "eps_px")
    edited = c.EditSetting(path, 3.0).apply(c.SetSlot("B").apply(state, 0.0), 0.0)
    assert get_setting(edited.configs.present.b, path) == 3.0
    assert edited.configs.present.a == DetectorConfig()
    assert c.Undo().apply(edited, 0.0).configs.present.b == DetectorConfig()
    assert c.Redo().apply(c.Undo().apply(edited, 0.0), 0.0).configs.present == edited.configs.present


def test_a_slider_out_of_range_is_refused_by_name(state: ClientState) -> None:
    with pytest.raises(ConfigError, match=r"ClusterConfig\.eps_px"):
        c.EditSetting(("cluster", "eps_px"), -3.0).apply(state, 0.0)


def test_copy_gives_the_other_slot_the_edited_config(state: ClientState) -> None:
    edited = c.EditSetting(("cluster", "eps_px"), 3.0).apply(state, 0.0)
    copied = c.CopyToOther().apply(edited, 9.0)
    assert copied.configs.present.b == edited.configs.present.a
    assert c.UseConfig(DetectorConfig()).apply(copied, 20.0).configs.present.a == DetectorConfig()


def test_another_camera_is_looked_at_as_a_whole(state: ClientState) -> None:
    assert c.LookAt((3.0, 4.0)).apply(state, 0.0) == state
    zoomed = c.LookAt((3.0, 4.0)).apply(c.SetZoom(4.0).apply(state, 0.0), 0.0)
    assert zoomed.tune.centre_px == (3.0, 4.0)
    assert c.SetCamera("right").apply(zoomed, 0.0).tune == replace(zoomed.tune, centre_px=None)


def test_a_chosen_cluster_is_known_in_every_mode_and_centres_the_zoom_of_its_own_camera(state: ClientState) -> None:
    zoomed = c.SetZoom(4.0).apply(state, 0.0)
    here, elsewhere = (PickedPoint(name, 9_000, (3.0, 4.0)) for name in ("left", "right"))
    chosen = c.PickCluster(here).apply(zoomed, 0.0)
    assert (chosen.tune.picked, chosen.tune.centre_px) == (here, (3.0, 4.0))
    chosen = c.PickCluster(elsewhere).apply(zoomed, 0.0)
    assert (chosen.tune.picked, chosen.tune.centre_px) == (elsewhere, None)


def test_a_config_that_was_found_stands_beside_the_one_it_was_found_from(state: ClientState) -> None:
    path = ("cluster", "eps_px")
    found = replace_setting(DetectorConfig(), path, 4.0)
    edited = c.EditSetting(path, 5.0).apply(state, 0.0)  # while it was searched for
    beside = c.UseBeside("auto", state.config, found).apply(edited, 1.0)
    assert beside.configs.present == Configs(state.config, found)
    assert beside.tune.compare and beside.tune.slot == "B" and beside.config == found
    assert c.Undo().apply(beside, 2.0).configs.present == edited.configs.present


REFINED_RADIUS = ("refined", "radius_max_px")


def test_a_method_without_stages_has_configs_of_its_own_in_windows_of_its_own(state: ClientState) -> None:
    refined = state
    assert refined.tune.method == "refined", "the default"
    assert refined.config == refined_config() and refined.own_configs == {}
    edited = c.EditSetting(REFINED_RADIUS, 20.0).apply(refined, 0.0)
    assert get_setting(edited.config, REFINED_RADIUS) == 20.0
    assert edited.configs == state.configs == c.SetMethod("auto").apply(edited, 0.0).history
    assert edited.detector == ("refined", edited.config), "Watch, Label and Export follow"
    assert edited.config_of("ebpp") == ebpp_config()
    assert c.Undo().apply(edited, 1.0).config == refined_config()
    assert c.Redo().apply(c.Undo().apply(edited, 1.0), 2.0).config == edited.config
    assert c.ResetConfig().apply(edited, 1.0).config == refined_config()


def test_a_method_that_was_not_edited_takes_its_section_from_the_file_that_is_loaded(state: ClientState) -> None:
    loaded = c.UseConfig(replace_setting(DetectorConfig(), REFINED_RADIUS, 20.0), "auto").apply(state, 0.0)
    assert loaded.tune.method == "auto", "the file's"
    assert loaded.config_of("refined") == replace_setting(refined_config(), REFINED_RADIUS, 20.0)


def test_auto_and_paper_share_their_configs(state: ClientState) -> None:
    paper = c.EditSetting(("cluster", "eps_px"), 5.0).apply(c.SetMethod("paper").apply(state, 0.0), 0.0)
    assert c.SetMethod("auto").apply(paper, 0.0).config == paper.config != state.config
    assert c.ResetConfig().apply(paper, 1.0).config == DetectorConfig()


def test_what_was_found_for_a_method_chooses_that_method(state: ClientState) -> None:
    found = replace_setting(refined_config(), REFINED_RADIUS, 20.0)
    beside = c.UseBeside("refined", refined_config(), found).apply(state, 0.0)
    assert beside.tune.method == "refined" and beside.config == found and beside.configs == state.configs
    apart = c.UseBeside("refined", refined_config(), found).apply(c.SetSideBySide(True).apply(state, 0.0), 0.0)
    assert apart == beside, "methods beside each other make room for the two configs"


def test_methods_that_take_part_are_in_their_usual_order(state: ClientState) -> None:
    more = c.CompareMethod("paper", True).apply(state, 0.0)
    assert more.tune.compared == ("auto", "paper", "refined")
    assert c.CompareMethod("auto", False).apply(more, 0.0).tune.compared == ("paper", "refined")
    assert c.CompareMethod("yolo", True).apply(state, 0.0) == state
    assert c.SetSideBySide(True).apply(state, 0.0).tune.side_by_side


def test_a_jump_ends_the_playing(state: ClientState) -> None:
    playing = c.TogglePlay().apply(state, 0.0)
    stopped = c.StopAt(300_000).apply(playing, 1.0)
    assert not stopped.playhead.playing and stopped.playhead.position_us(9.0) == 300_000
    assert c.StopAt(10**9).apply(playing, 1.0).playhead.position_us(9.0) == 1_000_000


def test_the_shuttle_plays_then_changes_speed_and_steps_back_while_it_stands(state: ClientState) -> None:
    standing = c.StopAt(100_000).apply(state, 0.0)
    playing = c.Shuttle(+1).apply(standing, 0.0)
    assert playing.playhead.playing and playing.playhead.speed == standing.playhead.speed
    faster = c.Shuttle(+1).apply(playing, 0.0)
    assert faster.playhead.speed > playing.playhead.speed
    assert c.Shuttle(-1).apply(faster, 0.0).playhead.speed == playing.playhead.speed
    assert c.Shuttle(-1).apply(standing, 0.0).playhead.position_us(0.0) == 90_000


def test_a_moment_of_a_camera_is_looked_into_in_another_mode(state: ClientState) -> None:
    playing = c.TogglePlay().apply(state, 0.0)
    after = c.LookInto("Tune", "right", 123_456).apply(playing, 1.0)
    assert (after.mode, after.camera, after.looks) == ("Tune", "right", state.looks + 1)
    assert not after.playhead.playing and after.playhead.position_us(9.0) == 123_456
    assert c.LookInto("Hack", "../x", -5).apply(state, 0.0).mode == state.mode  # type: ignore[arg-type]


def test_a_score_against_somebodys_labels_is_asked_for_once(state: ClientState) -> None:
    asked = c.AskForScore("right", "anna").apply(state, 0.0)
    assert (asked.mode, asked.camera, asked.score_by) == ("Tune", "right", "anna")
    assert c.BeginScore().apply(asked, 0.0).score_by is None
