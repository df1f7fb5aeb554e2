"""Rules of the house that the import linter does not see."""

import ast
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = ("app", "core", "labels")
SOURCES = [path for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]
FOLDERS = sorted({path.parent for path in SOURCES})
LONGEST_FILE = 400
LONGEST_FUNCTION = 80
MAX_SIBLINGS = 20
CROWDED = {"app/cli", "core/recordings/sources"}
"""One file for each verb, and one for each format of other tools."""


def test_the_light_parts_load_without_the_heavy_ones() -> None:
    code = "import core.events, core.recordings, core.detection, core.tuning, labels, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    ).stdout
    assert not {"torch", "mujoco", "viser", "rerun", "optuna"} & set(loaded.split())


def test_core_and_labels_know_no_browser() -> None:
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != "app":
            text = path.read_text()
            for name in ("viser", "rerun", "argparse", "tqdm"):
                assert f"import {name}" not in text and f"from {name}" not in text, path


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_is_one_idea(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= LONGEST_FILE
    assert path.stem not in {"utils", "helpers", "manager", "misc", "common"}
    assert path.stem not in sys.stdlib_module_names - {"__init__"}, "named like the standard library"


def functions_of(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    nodes = ast.walk(ast.parse(path.read_text()))
    return [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_function_fits_on_a_screen(path: Path) -> None:
    lengths = {node.name: (node.end_lineno or 0) - node.lineno + 1 for node in functions_of(path)}
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_FUNCTION} == {}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_folder_is_one_room(folder: Path) -> None:
    siblings = {path.name for path in folder.iterdir() if not path.name.startswith("__") and path.suffix in {"", ".py"}}
    assert len(siblings) <= MAX_SIBLINGS or str(folder.relative_to(ROOT)) in CROWDED, sorted(siblings)


def test_no_two_public_classes_have_one_name() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(ROOT)))
    assert len(places) > 300
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_every_part_is_typed_for_those_who_use_it() -> None:
    for part in PARTS:
        assert (ROOT / part / "py.typed").is_file()


def test_tests_are_no_packages() -> None:
    assert not list((ROOT / "tests").rglob("__init__.py"))
