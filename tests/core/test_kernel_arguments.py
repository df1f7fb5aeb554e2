"""Kernels take what belongs together as one named tuple, so that no two of many arguments can be exchanged."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
MOST = 8


def kernels() -> dict[str, int]:
    """How many arguments every kernel takes."""
    found = {}
    for part in ("app", "core", "labels"):
        for path in (ROOT / part).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list):
                    found[f"{path.relative_to(ROOT)}: {node.name}"] = len(node.args.args)
    return found


def test_no_kernel_takes_more_than_eight_arguments() -> None:
    found = kernels()
    assert len(found) > 100
    assert not {name for name, count in found.items() if count > MOST}
