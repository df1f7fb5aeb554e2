"""What a slider's box may send while somebody types into it."""

from dataclasses import replace

import pytest

from app.modes.tune.settings import FOLLOW, FOLLOWING, NO_BALL, REST_S, WHOLE, DebouncedEdit, follow_text, is_half_typed
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import EditSetting
from core.config import field_specs, replace_setting
from core.detection import DetectorConfig

SPECS = {spec.path: spec for spec in field_specs(DetectorConfig)}


@pytest.mark.parametrize(("value", "expected"), [(5, True), (49, True), (50, False), (500, False), (20_001, True)])
def test_a_number_outside_of_the_bounds_is_half_typed(value: int, expected: bool) -> None:
    assert is_half_typed(SPECS["window", "window_us"], value) is expected


def test_boxes_and_choices_are_never_half_typed() -> None:
    for spec in SPECS.values():
        assert not is_half_typed(spec, spec.default), spec.path
    assert not is_half_typed(SPECS["window", "window_us"], "500")


def test_a_number_that_does_not_go_with_the_others_waits_for_the_rest_of_it() -> None:
    """Of the 30 of a largest radius the 3 comes first: below the smallest radius, 10."""
    config = replace_setting(DetectorConfig(), ("localise", "radius_min_px"), 10.0)
    held, largest = DebouncedEdit(), ("localise", "radius_max_px")
    assert held.hold(EditSetting(largest, 3.0), config)
    assert held.rested(5.0) is None
    assert not held.hold(EditSetting(("window", "window_us"), 500), config)
    assert held.edit == EditSetting(largest, 3.0)  # another setting does not replace it
    assert not held.hold(EditSetting(largest, 30.0), config)
    assert held.edit is None and held.rested(99.0) is None


def test_what_stays_refused_is_judged_once_and_anew_after_more_was_typed() -> None:
    held, even = DebouncedEdit(), EditSetting(("ebpp", "kernel_px"), 4)
    assert held.hold(EditSetting(("ebpp", "kernel_px"), 2), DetectorConfig())
    assert held.rested(10.0) is None
    assert held.hold(even, DetectorConfig())
    assert held.rested(10.0 + REST_S) is None  # the time runs anew
    assert held.rested(10.0 + 2 * REST_S) == even
    assert held.rested(20.0) is None and held.edit is None


@pytest.mark.parametrize(
    ("zoom", "centre_px", "found", "text"),
    [
        (1.0, None, False, WHOLE),
        (6.0, (9.0, 9.0), True, FOLLOW),
        (6.0, (9.0, 9.0), False, FOLLOW),
        (6.0, None, True, FOLLOWING),
        (6.0, None, False, NO_BALL),
    ],
)
def test_a_ball_is_followed_only_where_one_is_found(zoom, centre_px, found: bool, text: str) -> None:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    state = ClientState("demo", ("left",), "left", Playhead(1_000_000), configs)
    state = replace(state, tune=replace(state.tune, zoom=zoom, centre_px=centre_px))
    assert follow_text(state, found=found) == text
