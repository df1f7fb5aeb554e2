import pytest

from app.shared.workspace import Workspace, slug_from
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


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandError, match="choose one with --data"):
        _ = Workspace(tmp_path / "file").recordings
