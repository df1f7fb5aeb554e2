"""Rules of the house that the import linter does not see."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [path for part in ("app", "core", "labels") for path in sorted((ROOT / part).rglob("*.py"))]


def test_the_light_parts_load_without_the_heavy_ones() -> None:
    code = "import core.events, core.recordings, core.detection, labels, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    ).stdout
    assert not {"torch", "mujoco", "viser", "rerun"} & set(loaded.split())


def test_core_and_labels_know_no_browser() -> None:
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != "app":
            text = path.read_text()
            for name in ("viser", "rerun", "argparse", "tqdm"):
                assert f"import {name}" not in text and f"from {name}" not in text, path


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_is_one_idea(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 400
    assert path.stem not in {"utils", "helpers", "manager", "misc", "common"}
    assert path.stem not in sys.stdlib_module_names - {"__init__"}, "named like the standard library"


def test_tests_are_no_packages() -> None:
    assert not list((ROOT / "tests").rglob("__init__.py"))
