from dataclasses import dataclass, field
from typing import Literal

import pytest

from core.config import (
    check_settings,
    config_from_mapping,
    config_to_mapping,
    field_specs,
    get_setting,
    load_config,
    replace_setting,
    save_config,
    setting,
)
from core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Inner:
    size_px: int = setting(3, 1, 9)
    """How large."""
    share: float = setting(0.5, 0.0, 1.0)
    mode: Literal["fast", "slow"] = "fast"

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    enabled: bool = True
    """Whether it runs
    at all."""

    def __post_init__(self) -> None:
        check_settings(self)


def test_specs_are_flat_ordered_and_documented() -> None:
    specs = field_specs(Outer)
    assert [spec.path for spec in specs] == [
        ("inner", "size_px"), ("inner", "share"), ("inner", "mode"), ("enabled",),
    ]  # fmt: skip
    assert [spec.kind for spec in specs] == [int, float, str, bool]
    assert specs[0].doc == "How large."
    assert specs[1].doc == ""
    assert specs[3].doc == "Whether it runs at all."
    assert specs[2].choices == ("fast", "slow")
    assert specs[0].bounds is not None and (specs[0].bounds.low, specs[0].bounds.high) == (1, 9)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size_px": 0}, "Inner.size_px: out of range; expected 1 to 9, got 0"),
        ({"size_px": 2.5}, "Inner.size_px: not a whole number"),
        ({"size_px": True}, "Inner.size_px: not a whole number"),
        ({"share": float("nan")}, "Inner.share: not a finite number"),
        ({"share": "much"}, "Inner.share: not a finite number"),
        ({"mode": "medium"}, "expected fast | slow, got 'medium'"),
    ],
)
def test_a_value_that_does_not_fit_is_named(values: dict, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Inner(**values)
    assert message in str(caught.value)


def test_replace_changes_one_leaf_and_checks_it() -> None:
    changed = replace_setting(Outer(), ("inner", "size_px"), 5)
    assert get_setting(changed, ("inner", "size_px")) == 5
    assert changed.inner.share == Outer().inner.share
    with pytest.raises(ConfigError):
        replace_setting(Outer(), ("inner", "size_px"), 50)


def test_a_saved_config_loads_as_itself(tmp_path) -> None:
    config = Outer(inner=Inner(size_px=7, share=0.25, mode="slow"), enabled=False)
    save_config(config, tmp_path / "new folder" / "a.toml")
    assert load_config(Outer, tmp_path / "new folder" / "a.toml") == config
    assert list((tmp_path / "new folder").iterdir()) == [tmp_path / "new folder" / "a.toml"]


def test_absent_settings_keep_their_defaults_and_whole_numbers_serve_as_floats() -> None:
    assert config_from_mapping(Outer, {"inner": {"share": 1}}, where="x") == Outer(inner=Inner(share=1.0))
    assert config_from_mapping(Outer, config_to_mapping(Outer()), where="x") == Outer()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[inner]\nsiz_px = 3\n", "unknown setting 'siz_px'; expected one of size_px, share, mode"),
        ("[inner]\nsize_px = 30\n", "Inner.size_px: out of range"),
        ("inner = 3\n", "not a table of settings"),
        ("[inner\n", "not a TOML file"),
    ],
)
def test_a_bad_file_gives_one_line_that_names_it(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(Outer, path)
    assert message in str(caught.value) and "bad.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_or_binary_file_is_a_config_error(tmp_path) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(Outer, tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a TOML file"):
        load_config(Outer, tmp_path / "binary.toml")


def test_saving_into_a_file_as_a_folder_is_a_config_error(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot write"):
        save_config(Outer(), tmp_path / "file" / "a.toml")
