"""All Python files of the product, read once for the tests that hold rules over each of them."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = ("app", "core", "labels")
SOURCES = [path for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))
