"""What the packages import is declared, and what is declared is imported and pinned."""

from __future__ import annotations

import ast
import functools
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Final

import pytest

from core.extras import EXTRAS

ROOT: Final = Path(__file__).parents[1]
OURS: Final = ("app", "benchmarks", "core", "labels")
PROJECT: Final = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS_OF: Final = {
    "benchmarks/app/": ("bench", "dev"),
    "app/export/onnx_actor.py": ("onnx",),
    "app/export/ros/": ("ros",),
    "benchmarks/": ("bench",),
    "benchmarks/mutation/": ("dev",),
    "core/jobs/cluster.py": ("cluster",),
    "core/metrics/charts.py": ("bench",),
    "core/learning/runs/sb3_baselines.py": ("baselines",),
    "core/recordings/sources/ros/": ("ros",),
    "core/tuning/search.py": ("tune",),
}
"""Files that may need more than a newcomer installs."""
CHECKERS: Final = {"labelimg", "mlcroissant"} | {
    *("absl-py", "decorator", "etils", "jsonpath-rw", "pandas-stubs", "ply", "rdflib", "six")
}
"""What the Makefile installs beside `dev` for tests that check our files with other people's code, and its parts:
labelImg without its Qt, mlcroissant because a part of it has no wheel."""


def normal(name: str) -> str:
    """A distribution's name as indexes compare them."""
    return re.sub(r"[-_.]+", "-", name).lower()


def names(requirements: list[str]) -> set[str]:
    """The distributions of some requirements, without their versions and extras."""
    found = (re.match(r"[\w.-]+", requirement) for requirement in requirements)
    return {normal(match.group()) for match in found if match} - {"rallyscope"}


def imported(path: Path) -> set[str]:
    """The top-level modules that a file imports, anywhere in it."""
    modules: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            modules.add(node.module)
    return {module.partition(".")[0] for module in modules}


@functools.cache
def distributions() -> Mapping[str, list[str]]:
    """Distributions of each module that is installed: seconds of reading, so not at import."""
    return packages_distributions()


def distributions_of(module: str) -> set[str]:
    """Who may bring a module; without an installed one, the one of its name."""
    return {normal(name) for name in distributions().get(module, [module])}


def foreign_imports() -> Iterator[tuple[str, str]]:
    """Every file of ours, tests aside, with every module in it that is neither ours nor Python's."""
    for part in OURS:
        for path in sorted((ROOT / part).rglob("*.py")):
            if path.is_relative_to(ROOT / "benchmarks" / "tests"):
                continue
            for module in sorted(imported(path) - sys.stdlib_module_names - set(OURS)):
                yield path.relative_to(ROOT).as_posix(), module


def allowed_in(path: str) -> set[str]:
    """What a file may import by what is declared."""
    extras = [extra for start, several in EXTRAS_OF.items() if path.startswith(start) for extra in several]
    optional = [requirement for extra in extras for requirement in PROJECT["optional-dependencies"][extra]]
    return names(PROJECT["dependencies"] + optional) | CHECKERS


def test_everything_that_is_imported_is_declared() -> None:
    missing = [(path, module) for path, module in foreign_imports() if not distributions_of(module) & allowed_in(path)]
    assert not missing


@pytest.mark.gate
def test_everything_that_a_newcomer_installs_is_imported() -> None:
    used = set().union(*(distributions_of(module) for _, module in foreign_imports()))
    assert names(PROJECT["dependencies"]) <= used


@pytest.mark.parametrize("extra", [None, *PROJECT["optional-dependencies"]])
def test_everything_that_is_declared_is_pinned(extra: str | None) -> None:
    wanted = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
    assert names(wanted) <= names((ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines())


def hashed() -> dict[str, tuple[str, list[str]]]:
    """Name -> version and hashes of the file that is installed from without trust in an index."""
    text = (ROOT / "constraints-hashed.txt").read_text(encoding="utf-8")
    blocks = re.findall(r"^([\w.-]+)==([^\s;]+)[^\n]*((?:\n    [^\n]*)*)", text, re.MULTILINE)
    return {
        normal(name): (version, re.findall(r"--hash=sha256:([0-9a-f]{64})", rest)) for name, version, rest in blocks
    }


def test_hashed_constraints_are_those_of_the_versions_that_are_tested() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    pinned = {normal(name): version for name, _, version in (line.partition("==") for line in lines)}
    found = hashed()
    for name, version in pinned.items():
        if name in found:
            assert found[name][0] == version, f"{name}: run `make hashes`"
    needed = names(PROJECT["dependencies"]) | names(PROJECT["optional-dependencies"]["dev"])
    assert not needed - set(found), "run `make hashes`"
    assert set(pinned) - set(found) <= CHECKERS


def test_every_hashed_constraint_has_hashes_and_no_address() -> None:
    found = hashed()
    assert len(found) > 90 and all(hashes for _, hashes in found.values())
    text = (ROOT / "constraints-hashed.txt").read_text(encoding="utf-8")
    assert "://" not in text and "--index" not in text and "--find-links" not in text and " @ " not in text


LIGHT = tomllib.loads((ROOT / "light" / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_light_package_and_its_extras_are_all_dependencies_with_the_same_bounds() -> None:
    project, extras = LIGHT["project"], LIGHT["project"]["optional-dependencies"]
    brought = [requirement for extra in EXTRAS.values() for requirement in extras[extra]]
    assert sorted(project["dependencies"] + brought) == sorted(PROJECT["dependencies"])
    for module, extra in EXTRAS.items():
        assert distributions_of(module) & names(extras[extra])
    assert extras["all"] == [f"rallyscope[{','.join(sorted(EXTRAS.values()))}]"]
    full = PROJECT["optional-dependencies"]
    assert extras == {name: full[name] for name in extras} and set(full) - set(extras) == {"bench", "dev", "docs"}


def test_the_light_package_is_this_one() -> None:
    whole = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert LIGHT["build-system"] == whole["build-system"]
    for key in ("name", "version", "requires-python", "scripts"):
        assert LIGHT["project"][key] == PROJECT[key]
    for key in ("packages", "package-data"):
        light = LIGHT["tool"]["setuptools"][key]
        light.get("find", {}).pop("where", None)
        assert light == whole["tool"]["setuptools"][key]
