"""Detectors that are registered: their section of the config, and what is refused."""

import pickle
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from core.config import field_specs, get_setting, load_config, replace_setting, save_config, setting
from core.detection import Detection, DetectorConfig, make_detector, register_detector
from core.detection.methods import METHODS, SECTIONS, STAGED, method_config
from core.errors import CommandError, ConfigError, PluginError
from core.events import SensorSize, Window
from core.registry import forgotten_afterwards
from core.tuning.parameters import choose_parameters, config_with

SENSOR = SensorSize(64, 48)


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerConfig:
    """Of a detector that always finds the ball at one place."""

    x_px: float = setting(3.0, 0.0, 10.0)
    """Where it is."""
    mirrored: bool = False


class CornerDetector:
    extra_circles = 0

    def __init__(self, config: CornerConfig, sensor: SensorSize) -> None:
        self.config, self.sensor = config, sensor

    def reset(self) -> None:
        pass

    def step(self, window: Window) -> Detection | None:
        return Detection(window.end_us, self.config.x_px, 0.0, 1.0)


@dataclass(frozen=True)
class WithoutBounds:
    size: float = 1.0


@dataclass(frozen=True)
class WithoutDefault:
    size: float


@dataclass
class NotFrozen:
    size: bool = True


@pytest.fixture
def corner() -> Iterator[None]:
    with forgotten_afterwards():
        register_detector("in-corner", CornerDetector, CornerConfig, "a corner", (1, 2, 3), window_us=750)
        yield


def test_its_config_is_a_section_beside_the_others(corner) -> None:
    assert list(METHODS)[-1] == "in-corner" and SECTIONS["in-corner"] == ("window", "in_corner")
    assert [spec.path for spec in field_specs(DetectorConfig)][-2:] == [
        ("in_corner", "x_px"),
        ("in_corner", "mirrored"),
    ]
    config = method_config("in-corner")
    assert config.window.window_us == 750 and get_setting(config, ("in_corner", "x_px")) == 3.0
    moved = replace_setting(config, ("in_corner", "x_px"), 4.0)
    made = make_detector("in-corner", SENSOR, moved)
    assert isinstance(made, CornerDetector) and made.config == CornerConfig(x_px=4.0) and made.sensor == SENSOR
    assert pickle.loads(pickle.dumps(moved)) == moved


def test_equal_configs_are_equal_and_have_one_hash(corner) -> None:
    there = replace_setting(DetectorConfig(), ("in_corner", "mirrored"), True)
    back = replace_setting(there, ("in_corner", "mirrored"), False)
    assert there != DetectorConfig() and back == DetectorConfig() and hash(back) == hash(DetectorConfig())


def test_it_is_saved_and_loaded_and_left_out_as_it_comes(corner, tmp_path: Path) -> None:
    config = replace_setting(method_config("in-corner"), ("in_corner", "x_px"), 4.5)
    save_config(config, tmp_path / "a.toml")
    assert "[in_corner]\nx_px = 4.5\nmirrored = false\n" in (tmp_path / "a.toml").read_text()
    assert load_config(DetectorConfig, tmp_path / "a.toml") == config
    save_config(method_config("in-corner"), tmp_path / "b.toml")
    assert "corner" not in (tmp_path / "b.toml").read_text(), "a file opens without a plugin that it does not need"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[in_corner]\nx_px = 11.0", "CornerConfig.x_px: out of range; expected 0 to 10, got 11"),
        ("[in_corner]\nmirrored = 1", "CornerConfig.mirrored: not a truth value"),
        ("[in_corner]\ny_px = 1.0", "unknown setting 'y_px'"),
        ("[registered]\nx_px = 1.0", "unknown setting 'registered'"),
        ("[nobody]\nx_px = 1.0", "unknown setting 'nobody'; expected one of window, .*, in_corner; .* --plugin"),
    ],
)
def test_what_does_not_fit_the_section_is_refused(corner, tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_config(DetectorConfig, tmp_path / "a.toml")


def test_a_section_that_is_not_registered_is_refused() -> None:
    with pytest.raises(ConfigError, match="no section 'other' of this kind"):
        replace(DetectorConfig(), registered=(("other", CornerConfig()),))


def test_it_is_tuned_by_its_own_fields(corner) -> None:
    start = method_config("in-corner")
    assert [one.name for one in choose_parameters("in-corner", start)] == ["in_corner.x_px", "in_corner.mirrored"]
    found = config_with(start, {"in_corner.x_px": 2.0})
    assert get_setting(found, ("in_corner", "x_px")) == 2.0 and found.window.window_us == 750


def test_ours_are_registered_the_same_way() -> None:
    assert set(METHODS) == {"auto", "paper", "refined", "ebpp", "fe-fusion"} and {"auto", "paper"} == STAGED
    with pytest.raises(CommandError, match=r"no method 'in-corner'; expected auto \| paper"):
        make_detector("in-corner", SENSOR)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": "refined"}, "the config has a section of this name already; got refined"),
        ({"name": "auto"}, "there is a detector 'auto' already"),
        ({"name": "window"}, "a section of this name already"),
        ({"name": "In Corner"}, "not a name of a detector"),
        ({"make": None}, "no way to make it; expected a class or a function"),
        ({"config": None}, "no config; expected a class with @dataclass"),
        ({"config": WithoutBounds}, "the setting size has no bounds"),
        ({"config": WithoutDefault}, "not a config"),
        ({"config": NotFrozen}, "no config"),
        ({"config": CornerConfig()}, "no config"),
        ({"label": " "}, "no label"),
        ({"colour": "red"}, r"not a colour; expected \(red, green, blue\)"),
        ({"colour": (1, 2, 300)}, "not a colour"),
        ({"window_us": 1}, "out of range"),
    ],
)
def test_what_does_not_fit_is_one_line(given: dict, said: str) -> None:
    whole = {"name": "new", "make": CornerDetector, "config": CornerConfig, "label": "x", "colour": (1, 2, 3), **given}
    with forgotten_afterwards(), pytest.raises((PluginError, ConfigError), match=said) as error:
        register_detector(whole.pop("name"), **whole)
    assert "\n" not in str(error.value) and set(METHODS) == {"auto", "paper", "refined", "ebpp", "fe-fusion"}
