"""The tool on a tiny package: what its tests see is killed, what they do not see lives, what none reaches is told."""

import ast
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.mutation.mutants import find_mutants
from benchmarks.mutation.mutate import AREAS, wilson

ROOT = Path(__file__).parents[3]
MUTATE = (sys.executable, "-m", "benchmarks.mutation.mutate")
CODE = """'''Sums.'''

import numpy as np


def add(a, b):
    '''The sum, none below zero; a comment with 1 < 2 is no code.'''
    return max(a + b, 0)


def is_large(a):
    return a > 10


def never(a):
    return a * 2


def count(items):
    total = 0
    while total < len(items):
        total += 1
    return total
"""
TEST = """import pytest

from tiny.sums import add, count, is_large


@pytest.fixture(scope="module")
def counted():
    return count("abc")


def test_add():
    assert add(2, 3) == 5 and add(-2, 0) == 0


def test_is_large():
    assert is_large(20) and not is_large(3)


def test_first(counted):
    pass


def test_count(counted):
    assert counted == 3
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A package with a test, an area and a mutant that is accepted."""
    files = {
        "tiny/__init__.py": "",
        "tiny/sums.py": CODE,
        "tests/test_sums.py": TEST,
        "pyproject.toml": "[tool.pytest.ini_options]\naddopts = '--import-mode=importlib'\n",
        "benchmarks/mutation/areas.toml": "[tiny]\nsources = ['tiny']\ntests = ['tests']\n",
        "benchmarks/mutation/equivalent.toml": (
            "[[mutant]]\nline = 'total = 0'\nmutated = 'total = 1'\nwhy = 'to see that it is left out'\n"
        ),
    }
    for name, text in files.items():
        path = tmp_path / "tree" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path / "tree"


def rows_of(tree: Path, *more: str) -> tuple[list[dict], str]:
    said = subprocess.run(
        [*MUTATE, "tiny", "--root", str(tree), "--start-s", "6", *more],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert said.returncode == 0, said.stderr
    return [json.loads(row) for row in (tree / ".mutation/tiny.jsonl").read_text().splitlines()], said.stdout


def test_what_the_tests_see_is_killed_and_what_they_do_not_lives(tree: Path) -> None:
    before = (tree / "tiny/sums.py").read_text()
    rows, said = rows_of(tree, "--seed", "1", "--jobs", "2")
    assert (tree / "tiny/sums.py").read_text() == before, "only the copy is changed"
    found = {(row["line"], row["mutated"]): (row["verdict"], row["by"].partition("::")[2] or row["by"]) for row in rows}
    by = found.pop(("total += 1", "total -= 1"))
    assert by[0] == "killed" and by[1].startswith("status -"), "it never ends"
    assert found == {
        ("return max(a + b, 0)", "return max(a - b, 0)"): ("killed", "test_add"),
        ("return a > 10", "return a >= 10"): ("survived", ""),  # no test has just 10
        ("return a * 2", "return None"): ("not reached", ""),
        ("while total < len(items):", "while total >= len(items):"): ("killed", "test_count"),  # by way of a fixture
        ("return total", "return None"): ("killed", "test_count"),
        ("total = 0", "total = 1"): ("equivalent", ""),
    }
    assert "survived: tiny/sums.py:12 (comparison)" in said and "not reached: tiny/sums.py:16" in said
    assert said.splitlines()[-1].startswith("tiny  7  4  1  1  1  67% (30% to 90%)")


NAMED_AFTER = """import pytest

from tiny.sums import LARGE, is_large


@pytest.mark.parametrize("a", [LARGE])
def test_the_limit_is_not_large(a):
    assert not is_large(a)
"""


def test_a_case_that_is_named_after_what_is_changed_is_asked_all_the_same(tree: Path) -> None:
    (tree / "tiny/sums.py").write_text("LARGE = 10\n\n\ndef is_large(a):\n    return a > LARGE\n")
    (tree / "tests/test_sums.py").write_text(NAMED_AFTER)
    rows, _ = rows_of(tree)
    assert {row["line"]: row["verdict"] for row in rows}["LARGE = 10"] == "survived", "nothing says how much is large"


SLOW_AND_WAITING = """import select


def test_computes():
    try:
        while True:
            pass
    except Exception:
        pass


def test_waits():
    select.select([], [], [], 0.6)
"""


def test_what_is_too_slow_goes_by_the_processor_and_not_by_the_clock(tmp_path: Path) -> None:
    (tmp_path / "test_slow.py").write_text(SLOW_AND_WAITING)
    measured = tmp_path / "tests.json"
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "reach", "-p", "no:cacheprovider", "test_slow.py"],
        cwd=tmp_path,
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT / "benchmarks/mutation"),
            "REACH_TESTS": str(measured),
            "REACH_SLOWEST_S": "0.5",
        },
        capture_output=True,
    )
    tests = json.loads(measured.read_text())
    assert {name.partition("::")[2]: test["passed"] for name, test in tests.items()} == {
        "test_computes": False,
        "test_waits": True,
    }


def test_an_area_that_names_a_folder_which_is_not_there_is_refused(tree: Path) -> None:
    (tree / "benchmarks/mutation/areas.toml").write_text("[tiny]\nsources = ['gone']\ntests = ['tests']\n")
    said = subprocess.run([*MUTATE, "tiny", "--root", str(tree)], cwd=ROOT, capture_output=True, text=True)
    assert said.returncode == 1 and "gone, which is not there" in said.stderr


def test_every_area_of_the_house_has_code_and_tests() -> None:
    areas = tomllib.loads((ROOT / AREAS).read_text(encoding="utf-8"))
    del areas["libraries"]
    for area in areas.values():
        for name in (*area["sources"], *area["tests"], *area.get("without", ())):
            assert (ROOT / name).exists(), name


def test_a_run_goes_on_where_it_was_and_asks_again_what_has_changed(tree: Path) -> None:
    first, _ = rows_of(tree, "--seed", "1", "--count", "2")
    again, _ = rows_of(tree, "--seed", "1", "--count", "2")
    assert again == first, "nothing was asked twice"
    results = tree / ".mutation/tiny.jsonl"
    results.write_text("".join(f"{json.dumps(row)}\n" for row in first[:1]), encoding="utf-8")
    resumed, _ = rows_of(tree, "--seed", "1", "--count", "2")

    def plain(rows: list[dict]) -> list[tuple]:
        return sorted((row["line"], row["mutated"], row["verdict"], row["by"]) for row in rows)

    assert plain(resumed) == plain(first) and resumed[:1] == first[:1]
    (tree / "tests/test_sums.py").write_text(TEST + "\n\ndef test_edge():\n    assert not is_large(10)\n")
    changed, _ = rows_of(tree, "--seed", "1", "--count", "2")
    assert len(changed) > len(first)


def test_every_mutant_is_a_program_and_no_other_text_is_touched() -> None:
    code = (
        "def f(a: int = 3, *, b=True) -> int:\n"
        '    """1 < 2"""\n'
        "    assert a < 5, 'no'\n"
        "    if not (a < 3 and b) or a is not None:\n"
        "        raise ValueError(f'{a + 1}')\n"
        "    größe = a & 0x7FF; x = -(a + 1)  # 3 < 4\n"
        "    return min(größe[1:-1], (a) - (b), x ** 2)\n"
    )
    found = find_mutants("a.py", code)
    after = [mutant.apply(code) for mutant in found]
    for text in after:
        ast.parse(text)
    assert len(set(after)) == len(after) and code not in after
    assert not any(mutant.line in (2, 3, 5) for mutant in found)
    changes = {mutant.lines(code)[1] for mutant in found}
    for line in (
        "if not (a <= 3 and b) or a is not None:",
        "if not (a < 3 or b) or a is not None:",
        "if (a < 3 and b) or a is not None:",
        "if not (a < 3 and b) or a is None:",
        "größe = a & 0x3ff; x = -(a + 1)  # 3 < 4",
        "größe = a | 0x7FF; x = -(a + 1)  # 3 < 4",
        "größe = a & 0x7FF; x = (a + 1)  # 3 < 4",
        "return max(größe[1:-1], (a) - (b), x ** 2)",
        "return min(größe[(1) + 1:-1], (a) - (b), x ** 2)",
        "return min(größe[1:(-1) - 1], (a) - (b), x ** 2)",
        "return min(größe[1:-1], (a) + (b), x ** 2)",
        "return None",
        "def f(a: int = 4, *, b=True) -> int:",
    ):
        assert line in changes
    assert not any("# 4" in line or "<= 4" in line for line in changes)


def test_intervals_are_those_of_wilson() -> None:
    assert [*wilson(8, 10), *wilson(0, 0)] == pytest.approx([0.4902, 0.9433, 0.0, 1.0], abs=1e-4)


def test_all_code_of_the_house_gives_mutants_that_are_programs() -> None:
    check: Callable[[str], object] = ast.parse
    for folder in ("core/trajectory", "core/recordings/sources"):
        for path in sorted((ROOT / folder).glob("*.py")):
            text = path.read_text(encoding="utf-8")
            for mutant in find_mutants(path.name, text)[::7]:
                check(mutant.apply(text))
