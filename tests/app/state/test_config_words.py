"""What is changed from the default, over all methods, and how it is named."""

from app.modes.tune.auto_tune import loses_config, trial_words
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import CopyToOther, EditSetting, ResetAllConfigs, ResetConfig, SetMethod, SetSlot, Undo
from app.state.config_words import ShowChangedConfig, changed_configs, changed_words, detector_words, settings_words
from core.detection import DetectorConfig
from core.detection.methods import method_config


def fresh() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("serve", ("left",), "left", Playhead(1000), configs)


def after(state: ClientState, *commands) -> ClientState:
    for number, command in enumerate(commands):
        state = command.apply(state, 10.0 * number)
    return state


CHANGES = (
    SetMethod("auto"),
    EditSetting(("localise", "radius_max_px"), 20.0),
    EditSetting(("cluster", "eps_px"), 4.0),
    SetMethod("refined"),
    SetSlot("B"),
    EditSetting(("refined", "motion_px"), 5.0),
)


def test_changes_of_all_methods_are_counted_and_reset_of_one_method_leaves_the_others_marked() -> None:
    assert changed_words(changed_configs(fresh())) == ""
    state = after(fresh(), *CHANGES)
    assert changed_words(changed_configs(state)) == "3 settings changed from default: A of auto (2), B of refined (1)"
    reset = after(state, ResetConfig())
    assert changed_words(changed_configs(reset)) == "2 settings changed from default: A of auto"
    everything = after(state, ResetAllConfigs())
    assert changed_words(changed_configs(everything)) == ""
    undone = after(everything, SetMethod("auto"), Undo())
    assert changed_words(changed_configs(undone)) == "2 settings changed from default: A of auto"


def test_show_goes_round_through_the_changed_configs() -> None:
    state, seen = after(fresh(), *CHANGES), []
    for _ in range(3):
        state = after(state, ShowChangedConfig())
        seen.append((state.tune.method, state.tune.slot))
    assert seen == [("auto", "A"), ("refined", "B"), ("auto", "A")]
    assert after(fresh(), ShowChangedConfig()) == fresh()


def test_settings_of_other_methods_are_not_named() -> None:
    state = after(fresh(), *CHANGES)
    assert settings_words("auto", state.history_of("auto").present.a) == "cluster.eps_px 4, localise.radius_max_px 20"
    assert settings_words("refined", state.history_of("ebpp").present.a) != "cluster.eps_px 4"


def test_a_running_search_says_which_trial_it_is_at_and_the_best_so_far() -> None:
    assert trial_words("12 of 24 trials, best 0.9560") == "trial 12 of 24, best 0.9560"
    assert trial_words("1 of 24 trials") == "trial 1 of 24"


def test_a_search_asks_before_it_replaces_a_b_that_somebody_made() -> None:
    plain = method_config("refined")
    own = after(fresh(), *CHANGES).history_of("refined").present
    assert loses_config("refined", own)
    assert not loses_config("refined", Configs(plain, plain))
    copied = after(after(fresh(), *CHANGES), CopyToOther()).history_of("refined").present
    assert not loses_config("refined", copied), "A is the same"


def test_what_detects_in_every_mode_is_the_config_that_is_shown() -> None:
    state = after(fresh(), *CHANGES)
    assert detector_words(state) == "refined, config B (refined.motion_px 5)"
    assert state.detector == ("refined", state.history.present.b)
