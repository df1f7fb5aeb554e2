"""A browser is found wherever one is usually installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ensure_chromium import MAC_APPLICATIONS, NAMES, find_chromium
from tests.waiting import PATIENCE_S

SCRIPT = Path(__file__).with_name("ensure_chromium.py")


def program(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def nothing(tmp_path: Path) -> dict[str, str]:
    """An environment without any browser."""
    (tmp_path / "bin").mkdir()
    return {"PATH": str(tmp_path / "bin"), "HOME": str(tmp_path / "home")}


def find(environment: dict[str, str], tmp_path: Path) -> Path | None:
    return find_chromium(environment, application_folders=[tmp_path / "Applications"])


def test_there_may_be_none(nothing: dict[str, str], tmp_path: Path) -> None:
    assert find(nothing, tmp_path) is None


@pytest.mark.parametrize("name", NAMES)
def test_any_usual_name_on_the_path_will_do(name: str, nothing: dict[str, str], tmp_path: Path) -> None:
    expected = program(tmp_path / "bin" / name)
    assert find(nothing, tmp_path) == expected


@pytest.mark.parametrize("name", MAC_APPLICATIONS)
def test_an_application_of_macos_will_do(name: str, nothing: dict[str, str], tmp_path: Path) -> None:
    expected = program(tmp_path / "Applications" / f"{name}.app" / "Contents" / "MacOS" / name)
    assert find(nothing, tmp_path) == expected


@pytest.mark.parametrize(
    "place",
    [
        "home/.cache/ms-playwright/chromium-1200/chrome-linux/chrome",
        "home/.cache/ms-playwright/chromium-1200/chrome-linux64/chrome",
        "home/Library/Caches/ms-playwright/chromium-1200/chrome-mac/Chromium.app/Contents/MacOS/Chromium",
    ],
)
def test_playwrights_own_will_do(place: str, nothing: dict[str, str], tmp_path: Path) -> None:
    expected = program(tmp_path / place)
    assert find(nothing, tmp_path) == expected


def test_playwrights_folder_may_be_elsewhere(nothing: dict[str, str], tmp_path: Path) -> None:
    expected = program(tmp_path / "browsers" / "chromium-1200" / "chrome-linux" / "chrome")
    assert find({**nothing, "PLAYWRIGHT_BROWSERS_PATH": str(tmp_path / "browsers")}, tmp_path) == expected


def test_the_named_browser_comes_first_and_is_not_replaced(nothing: dict[str, str], tmp_path: Path) -> None:
    program(tmp_path / "bin" / "chromium")
    named = program(tmp_path / "elsewhere" / "my-chrome")
    assert find({**nothing, "RALLYSCOPE_CHROMIUM": str(named)}, tmp_path) == named
    assert find({**nothing, "RALLYSCOPE_CHROMIUM": str(tmp_path / "missing")}, tmp_path) is None


@pytest.mark.parametrize(("more", "code"), [({}, 0), ({"CI": "1"}, 1)])
def test_without_one_it_says_what_to_do(more: dict[str, str], code: int, nothing: dict[str, str]) -> None:
    environment = {**nothing, **more, "RALLYSCOPE_CHROMIUM": os.devnull}
    done = subprocess.run(
        [sys.executable, str(SCRIPT)], env=environment, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == code
    for part in ("playwright install chromium", "RALLYSCOPE_CHROMIUM=/path/to/chrome", f"{os.devnull} is no program"):
        assert part in done.stdout
