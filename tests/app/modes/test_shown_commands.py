"""The commands that the app shows are commands that the command line takes."""

import re
import shlex
from pathlib import Path

from app.cli.main import parse
from app.modes.tune.settings import detect_command
from app.modes.watch.view_panel import WHY_FLAT_HTML


def arguments_of(command: str) -> list[str]:
    program, *arguments = shlex.split(command)
    assert program == "rallyscope"
    return arguments


def test_a_saved_config_is_used_by_the_command_in_its_note() -> None:
    parsed = parse(arguments_of(detect_command("refined", Path("configs/dot.toml"))))
    assert str(parsed.config) == "configs/dot.toml" and parsed.method == "refined"


def test_two_cameras_become_one_new_recording_by_the_command_that_is_named() -> None:
    (command,) = re.findall(r"<code>(.*?)</code>", WHY_FLAT_HTML)
    parsed = parse(arguments_of(command))
    assert [str(path) for path in parsed.paths] == ["LEFT", "RIGHT", "OUT.h5"]
    assert str(parsed.calibration) == "FILE"
