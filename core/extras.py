"""Packages that a light installation lacks, and the one line that says which is missing and how to get it.

A full installation has all of them. A light one, see docs/use/installation.md, leaves out the large ones, which only
some verbs and buttons need; what needs one imports it when it is first used.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from typing import Final

from core.errors import PackageError

EXTRAS: Final[Mapping[str, str]] = {
    "av": "film",
    "mujoco": "simulation",
    "pyarrow": "data",
    "rerun": "rerun",
    "torch": "learn",
}
"""Top-level module -> extra that brings it."""


def require_package(module: str, purpose: str) -> None:
    """Check that a package is installed, before work that would need it only at its end.

    Raises:
        PackageError: if it is not; `purpose` begins the message, such as "training".
    """
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # what stands in for a module, such as a test's, may have no spec
        found = True
    if not found:
        raise _missing(module, purpose)


def missing_package(error: BaseException) -> PackageError | None:
    """The message for an import that failed because an extra is not installed; None for any other error."""
    name = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    return _missing(name, "this") if name in EXTRAS else None


def _missing(module: str, purpose: str) -> PackageError:
    extra = EXTRAS[module]
    remedy = f"pip install 'rallyscope[{extra}]'"
    return PackageError(f"{purpose} needs {module}, which is not installed", remedy=remedy)
