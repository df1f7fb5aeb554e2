import dataclasses

import pytest

from core.config import config_to_mapping, field_specs, load_config, replace_setting, save_config
from core.detection import DetectorConfig, TrackState, auto_config, paper_config, trace_window
from core.detection.methods import SECTIONS
from core.errors import ConfigError


def test_every_setting_has_a_documentation_line_and_every_number_bounds() -> None:
    for spec in field_specs(DetectorConfig):
        assert spec.doc, spec.path
        assert (spec.bounds is not None) == (spec.kind in (int, float)), spec.path


def test_a_saved_config_loads_as_the_same(tmp_path) -> None:
    config = replace_setting(auto_config(), ("geometry", "circularity_min"), 0.71)
    save_config(config, tmp_path / "mine.toml")
    assert load_config(DetectorConfig, tmp_path / "mine.toml") == config


def test_every_section_is_of_a_stage_or_of_one_method(make_scene) -> None:
    config = replace_setting(auto_config(), ("hot_pixels", "enabled"), True)
    config = replace_setting(config, ("flicker", "enabled"), True)
    trace = trace_window(make_scene(duration_us=2000).windows()[0], TrackState(), config)
    sections = [field.name for field in dataclasses.fields(DetectorConfig) if "sections" not in field.metadata]
    assert sections[0] == "window"
    own = [SECTIONS[method][1] for method in ("refined", "ebpp", "fe-fusion")]
    assert sections[1:] == [stage.name for stage in trace.stages] + own


def test_paper_takes_only_what_the_paper_does_and_keeps_the_rest() -> None:
    mine = replace_setting(auto_config(), ("hot_pixels", "enabled"), True)
    mine = replace_setting(replace_setting(mine, ("flicker", "enabled"), True), ("cluster", "eps_px"), 4.0)
    paper = paper_config(mine)
    assert paper.polarity.leading_polarity == "on"
    assert not paper.hot_pixels.enabled and not paper.flicker.enabled
    assert paper.cluster.eps_px == 4.0


def test_auto_and_paper_differ_in_the_leading_polarity_alone() -> None:
    auto, paper = config_to_mapping(auto_config()), config_to_mapping(paper_config())
    assert {name for name in auto if auto[name] != paper[name]} == {"polarity"}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("denoise", "kernel_px"), 4),
        (("localise", "radius_max_px"), 2.0),
        (("cluster", "size_max"), 20),
        (("flicker", "frequency_max_hz"), 50.0),
        (("window", "window_us"), 0),
        (("polarity", "leading_polarity"), "up"),
        (("ebpp", "kernel_px"), 4),
        (("ebpp", "blur_px"), 6),
        (("ebpp", "radius_max_px"), 3),
        (("fe_fusion", "kernel_px"), 4),
        (("fe_fusion", "radius_max_px"), 3.5),
        (("fe_fusion", "eps_px"), 0.0),
    ],
)
def test_impossible_settings_are_refused_with_the_name_of_the_field(path: tuple[str, str], value: object) -> None:
    with pytest.raises(ConfigError, match=path[1]):
        replace_setting(auto_config(), path, value)  # pyright: ignore[reportArgumentType]
