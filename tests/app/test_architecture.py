"""Rules of the house that the import linter does not see."""

import ast
import re
import subprocess
import sys
import warnings
from collections import defaultdict
from itertools import pairwise

import pytest

from tests.sources import PARTS, ROOT, SOURCES, name_of, tree_of
from tests.waiting import PATIENCE_S

LONG_FILE = 600
"""A file of more lines gets a warning, and no more: it may well be one topic."""
LONGEST_FUNCTION = 80
FRAGMENT = re.compile(r"Of |The opposite")
"""How a docstring begins that makes no sense without the neighbour above it."""
UNFIT_WORDS = {"told", "said", "heard"}
"""Words for what people do; the field says reported, predicted, received."""
STORED_NAMES = {"core/robot/robot_messages.py: said", "app/cli/evaluate.py: told_after_ms"} | {
    "core/live/worlds/simulated_returns.py: told_after_ms"
}
"""A key of a message and a flag, which stay as they are."""


def test_the_light_parts_load_without_the_heavy_ones() -> None:
    code = "import core.events, core.recordings, core.detection, core.tuning, labels, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    ).stdout
    assert not {"torch", "mujoco", "viser", "rerun", "optuna"} & set(loaded.split())


def test_core_and_labels_know_no_browser() -> None:
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != "app":
            text = path.read_text()
            for name in ("viser", "rerun", "argparse", "tqdm"):
                assert f"import {name}" not in text and f"from {name}" not in text, path


def test_no_file_is_named_for_nothing_or_like_the_standard_library() -> None:
    unfit = {"utils", "helpers", "manager", "misc", "common"} | sys.stdlib_module_names - {"__init__"}
    assert [name_of(path) for path in SOURCES if path.stem in unfit] == []


def test_long_files_are_pointed_out() -> None:
    assert len(SOURCES) > 500
    for path in SOURCES:
        if (lines := len(path.read_text().splitlines())) > LONG_FILE:
            warnings.warn(f"{name_of(path)} has {lines} lines, more than {LONG_FILE}: is it one topic?", stacklevel=1)


@pytest.mark.gate
def test_a_function_fits_on_a_screen() -> None:
    lengths = {
        f"{name_of(path)}: {node.name}": (node.end_lineno or 0) - node.lineno + 1
        for path in SOURCES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert len(lengths) > 3000
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_FUNCTION} == {}


def test_no_two_public_classes_have_one_name() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        for node in tree_of(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name_of(path))
    assert len(places) > 300
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_a_docstring_begins_with_what_the_thing_is() -> None:
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    first = {
        f"{name_of(path)}:{node.body[0].lineno}": (ast.get_docstring(node) or "").split("\n")[0]
        for path in SOURCES
        for node in ast.walk(tree_of(path))
        if isinstance(node, kinds) and node.body
    }
    assert len(first) > 4000
    assert {place: line for place, line in first.items() if FRAGMENT.match(line)} == {}


def attribute_docstrings(tree: ast.Module) -> dict[int, str]:
    """The strings under assignments, which describe constants and fields, by line."""
    return {
        below.lineno: below.value.value
        for node in ast.walk(tree)
        if isinstance(body := getattr(node, "body", None), list)
        for above, below in pairwise(body)
        if isinstance(above, ast.Assign | ast.AnnAssign)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


def test_the_docstring_of_a_field_or_constant_begins_with_what_it_is() -> None:
    assert attribute_docstrings(ast.parse("class A:\n    x: int\n    'Of this.'\ny = 1\n'Of that.'")) == {
        3: "Of this.",
        5: "Of that.",
    }
    first = {
        f"{name_of(path)}:{line}": text
        for path in SOURCES
        for line, text in attribute_docstrings(tree_of(path)).items()
    }
    assert len(first) > 1000
    assert {place: text for place, text in first.items() if FRAGMENT.match(text)} == {}


def names_in(tree: ast.Module) -> set[str]:
    """All names that a file gives: of classes, functions, arguments, variables and fields."""
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                found.add(name)
            case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                found.add(name)
    return found


def test_names_say_it_in_the_words_of_the_field() -> None:
    assert names_in(ast.parse("class Said:\n    def f(self, to_be_told): self.heard_us = 1")) >= {"Said", "heard_us"}
    unfit = {
        f"{name_of(path)}: {name}"
        for path in SOURCES
        for name in names_in(tree_of(path))
        if UNFIT_WORDS & {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}
    }
    assert unfit == STORED_NAMES


def test_what_is_forgotten_short_of_everything_is_named() -> None:
    """`reset` forgets everything, `forget_flight` the flight: `forget` alone was the one here and the other there."""
    bare = [
        name_of(path)
        for path in SOURCES
        for node in ast.walk(tree_of(path))
        if path.relative_to(ROOT).parts[0] == "core" and isinstance(node, ast.FunctionDef) and node.name == "forget"
        if [argument.arg for argument in node.args.args] == ["self"]
    ]
    assert bare == []


def test_every_part_is_typed_for_those_who_use_it() -> None:
    for part in PARTS:
        assert (ROOT / part / "py.typed").is_file()


def test_tests_are_no_packages() -> None:
    assert not list((ROOT / "tests").rglob("__init__.py"))
