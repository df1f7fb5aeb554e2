import pytest

from app.shared.workspace import Workspace, slug_from
from core.config import replace_setting, save_config
from core.detection import DetectorConfig
from core.errors import CommandError


@pytest.mark.parametrize(
    ("typed", "slug"),
    [
        ("My config 2", "my-config-2"),
        ("../../etc/passwd", "etc-passwd"),
        ("a" * 200, "a" * 63),
        ("Ünïcode x", "n-code-x"),
    ],
)
def test_what_people_type_becomes_a_plain_name(typed: str, slug: str) -> None:
    assert slug_from(typed) == slug


@pytest.mark.parametrize("typed", ["", "   ", "...", "///", "\x00", "-_-"])
def test_a_name_with_nothing_in_it_is_refused(typed: str) -> None:
    with pytest.raises(CommandError, match="not a usable name"):
        slug_from(typed)


def test_paths_never_leave_the_workspace(tmp_path) -> None:
    workspace = Workspace(tmp_path / "data")
    assert workspace.config_path("../x").parent == tmp_path / "data" / "configs"
    assert workspace.recording_path("/abs").parent == tmp_path / "data" / "recordings"


def test_only_plain_names_are_offered(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    for name in ("b.toml", "a.toml", ".hidden.toml", "Not A Slug.toml", "a.txt"):
        (workspace.configs / name).write_text("")
    assert workspace.config_names() == ("a", "b")


def test_a_config_is_never_saved_over_another_one(tmp_path) -> None:
    workspace, config = Workspace(tmp_path), DetectorConfig()
    other = replace_setting(config, ("localise", "radius_max_px"), 17.0)
    first = workspace.free_config_path("Mine", config)
    assert first.name == "mine.toml"
    save_config(config, first)
    assert workspace.free_config_path("mine", config) == first  # the same may be saved again
    second = workspace.free_config_path("mine", other)
    assert second.name == "mine-2.toml"
    save_config(other, second)
    assert workspace.free_config_path("mine", other) == second
    second.write_text("not a config")
    assert workspace.free_config_path("mine", other).name == "mine-3.toml"


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandError, match="choose one with --data"):
        _ = Workspace(tmp_path / "file").recordings
