"""Which thresholds there are, and their scales."""

from dataclasses import replace

import pytest

from core.config import get_setting, replace_setting
from core.detection import DetectorConfig, make_detector
from core.detection.methods import METHODS, SECTIONS, method_config
from core.errors import CommandError, ConfigError
from core.events import SensorSize
from core.tuning.parameters import USUAL, choose_parameters, config_with, tunable_parameters

START = DetectorConfig()


def names(method: str, *chosen: str, start: DetectorConfig = START) -> list[str]:
    return [parameter.name for parameter in choose_parameters(method, start, chosen or None)]


@pytest.mark.parametrize("method", METHODS)
def test_the_usual_parameters_of_a_method_are_all_its_own(method: str) -> None:
    start = method_config(method)
    chosen = names(method, start=start)
    assert chosen and set(chosen) == set(USUAL.get(method, chosen))
    assert {name.partition(".")[0] for name in chosen} <= set(SECTIONS[method])  # type: ignore[index]
    make_detector(method, SensorSize(64, 48), start).reset()


def test_refined_has_nothing_of_the_stages_but_the_window() -> None:
    sections = {parameter.spec.path[0] for parameter in tunable_parameters("refined", START)}
    assert sections == {"window", "refined"}


def test_paper_does_not_tune_what_it_decides_itself_nor_what_it_switches_off() -> None:
    offered = {parameter.name for parameter in tunable_parameters("paper", START)}
    assert "polarity.leading_polarity" not in offered and "polarity.outlier_radius_px" in offered
    assert not any(name.startswith(("hot_pixels.", "flicker.")) for name in offered)
    assert "polarity.leading_polarity" in {parameter.name for parameter in tunable_parameters("auto", START)}


def test_a_section_stands_for_all_of_its_fields_and_the_order_is_the_configs() -> None:
    assert names("auto", "geometry", "cluster.eps_px") == [
        "cluster.eps_px", "geometry.circularity_min", "geometry.solidity_min",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["cluster.nonsense", "nonsense", "refined.delay_us", ""])
def test_an_unknown_name_is_one_line_that_lists_what_there_is(name: str) -> None:
    with pytest.raises(ConfigError, match=r"'auto' has no parameter .*; expected one of .*cluster\.eps_px") as error:
        names("auto", name)
    assert "\n" not in str(error.value)


def test_a_method_that_there_is_not_is_refused() -> None:
    with pytest.raises(CommandError, match="no method 'magic'"):
        names("magic")


def test_a_stage_that_is_off_is_tuned_only_with_its_switch() -> None:
    with pytest.raises(ConfigError, match=r"hot_pixels.tick_ms does nothing while hot_pixels.enabled is false"):
        names("auto", "hot_pixels.tick_ms")
    assert names("auto", "hot_pixels.tick_ms", "hot_pixels.enabled") == ["hot_pixels.enabled", "hot_pixels.tick_ms"]
    on = replace_setting(START, ("hot_pixels", "enabled"), True)
    assert names("auto", "hot_pixels.tick_ms", start=on) == ["hot_pixels.tick_ms"]
    assert "roi.roi_expand_px" not in names("auto", start=replace_setting(START, ("roi", "enabled"), False))


@pytest.mark.parametrize("method", METHODS)
def test_every_number_has_a_scale_that_gives_back_its_default_and_stays_in_its_bounds(method: str) -> None:
    for parameter in tunable_parameters(method, method_config(method)):
        bounds, default = parameter.spec.bounds, parameter.spec.default
        if bounds is None:
            assert parameter.choices is not None and default in parameter.choices
            continue
        assert isinstance(default, (int, float))
        place = parameter.place_of(default)
        assert 0.0 <= place <= 1.0 and parameter.value_at(place) == pytest.approx(default, abs=0.51 * bounds.step)
        for value in (parameter.value_at(0.0), parameter.value_at(0.37), parameter.value_at(1.0)):
            assert bounds.low <= value <= bounds.high and isinstance(value, parameter.spec.kind), parameter.name
            steps = (value - bounds.low) / bounds.step
            assert steps == pytest.approx(round(steps)), parameter.name


def test_a_bound_far_above_the_default_does_not_take_most_of_the_scale() -> None:
    (size_max,) = choose_parameters("auto", START, ["cluster.size_max"])  # 10 to 200,000, and 6000
    assert size_max.place_of(6000) > 0.4 and size_max.value_at(0.3) < 2000


def test_all_values_are_put_in_at_once() -> None:
    values = {"localise.radius_min_px": 50.0, "localise.radius_max_px": 60.0}  # either alone does not go with the other
    config = config_with(START, values)
    assert get_setting(config, ("localise", "radius_min_px")) == 50.0
    assert replace(config, localise=START.localise) == START
    with pytest.raises(ConfigError, match="no radius is allowed"):
        config_with(START, {"localise.radius_min_px": 50.0})
