import subprocess
import sys

import pytest

from app.shared.library import Library
from app.shared.workspace import Workspace, free_path, slug_from
from core import files
from core.config import replace_setting, save_config
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector, load_detector
from core.errors import CommandError
from tests.waiting import PATIENCE_S


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


@pytest.mark.parametrize("typed", ["", "   "])
def test_a_name_that_was_not_typed_is_missing(typed: str) -> None:
    with pytest.raises(CommandError, match="a name is missing"):
        slug_from(typed)


@pytest.mark.parametrize("typed", ["...", "///", "\x00", "-_-"])
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
    workspace, config = Workspace(tmp_path), SavedDetector("auto", DetectorConfig())
    other = config._replace(config=replace_setting(config.config, ("localise", "radius_max_px"), 17.0))
    first = workspace.keep_config("Mine", config)
    assert first.name == "mine.toml" and load_detector(first) == config
    assert workspace.keep_config("mine", config) == first  # the same may be saved again
    second = workspace.keep_config("mine", other)
    assert second.name == "mine-2.toml" and load_detector(second) == other
    assert workspace.keep_config("mine", other) == second
    second.write_text("not a config")
    assert workspace.keep_config("mine", other).name == "mine-3.toml"
    assert sorted(path.name for path in workspace.configs.iterdir()) == ["mine-2.toml", "mine-3.toml", "mine.toml"]
    kept = [workspace.keep_config("a" * 63, one).stem for one in (config, other)]
    assert kept == ["a" * 63, "a" * 61 + "-2"], "the longest name has a number, too"


def test_one_config_that_two_servers_save_at_once_is_one_config(tmp_path, monkeypatch) -> None:
    workspace, config, put = Workspace(tmp_path), SavedDetector("auto", DetectorConfig()), files.put_beside

    def quicker(source, path) -> None:
        save_config(config.config, path)  # another server, just then
        put(source, path)

    monkeypatch.setattr("app.shared.workspace.put_beside", quicker)
    assert workspace.keep_config("mine", config).name == "mine.toml"
    assert workspace.config_names() == ("mine",)


def test_the_same_settings_of_another_method_are_another_config(tmp_path) -> None:
    workspace, config = Workspace(tmp_path), DetectorConfig()
    save_config(config, workspace.config_path("mine"))  # as an earlier version did, for what was `auto`
    assert workspace.keep_config("mine", SavedDetector("auto", config)).name == "mine.toml"
    assert workspace.keep_config("mine", SavedDetector("paper", config)).name == "mine-2.toml"
    assert load_detector(workspace.config_path("mine-2")) == ("paper", config)


SAVES = """
import sys
from pathlib import Path
from app.shared.workspace import Workspace
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
workspace, number = Workspace(Path(sys.argv[1])), int(sys.argv[2])
configs = [replace_setting(DetectorConfig(), ("localise", "radius_max_px"), 10.0 + number + k / 64) for k in range(15)]
print(1, flush=True)
sys.stdin.readline()
for config in configs:
    workspace.keep_config("mine", SavedDetector("auto", config))
"""


@pytest.mark.gate
def test_servers_on_one_folder_that_save_under_one_name_lose_no_config_and_double_none(tmp_path) -> None:
    command = [sys.executable, "-c", SAVES, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    servers = [subprocess.Popen([*command, str(number)], **pipes) for number in range(3)]
    for server in servers:
        server.stdout.readline()
    for server in servers:
        server.stdin.write("go\n")
        server.stdin.flush()
    assert [server.wait(PATIENCE_S) for server in servers] == [0, 0, 0]
    for server in servers:
        server.stdin.close()
        server.stdout.close()
    workspace = Workspace(tmp_path)
    kept = [load_detector(workspace.config_path(name)).config for name in workspace.config_names()]
    assert sorted(config.localise.radius_max_px for config in kept) == sorted(
        10.0 + number + k / 64 for number in range(3) for k in range(15)
    )


def test_a_config_that_cannot_be_kept_is_one_clear_line(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    workspace.configs.rmdir()
    (tmp_path / "configs").write_text("a file in the way")
    with pytest.raises(CommandError, match="cannot use the workspace folder"):
        workspace.keep_config("mine", SavedDetector("auto", DetectorConfig()))


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandError, match="choose one with --data"):
        _ = Workspace(tmp_path / "file").recordings


def test_recordings_of_the_live_rally_that_are_begun_at_once_have_names_of_their_own(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("app.shared.workspace.time.strftime", lambda _: "live-now")
    Workspace(tmp_path).recording_path("live-now-2").touch()
    with Workspace(tmp_path).new_live_path() as one, Workspace(tmp_path).new_live_path() as other:
        assert (one.stem, other.stem) == ("live-now", "live-now-3")
        assert Library(Workspace(tmp_path)).names() == ("live-now-2",), "a claim is no recording"
    with Workspace(tmp_path).new_live_path() as again:
        assert again == one, "nothing was recorded"


def test_a_folder_that_takes_no_file_is_one_clear_line(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandError, match="cannot write"), free_path([tmp_path / "file" / "a.json"]):
        pass
