"""What figures were measured on, whether they are what was aimed at, and a report of rows as they are measured: some
take many minutes to the last.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, runtime_checkable

Row = dict[str, object]


def describe_machine(*packages: str, **remarks: str) -> dict[str, object]:
    """Processor, load, and versions of Python and the named packages, with remarks such as the clock that was used."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.partition(":")[2].strip() for line in info.read_text("utf-8").splitlines() if line[:10] == "model name"
        ]
        cpu = f"{len(names)} x {names[0]}" if names else cpu
    return {
        "cpu": cpu,
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
        **remarks,
    }


def machine_words(machine: Mapping[str, object]) -> str:
    """The machine as text for a report."""
    return ", ".join(f"{name} {value}" for name, value in machine.items() if value is not None)


def goal_row(what: str, measured: float, goal: float, unit: str, *, least: bool = False, note: str = "") -> Row:
    """A figure, its goal (at most, or at least), and whether that is met."""
    met = measured >= goal if least else measured <= goal
    row: Row = {"what": what, "measured": float(measured), "goal": f"{'>=' if least else '<='} {goal:g}"}
    return {**row, "unit": unit, "met": bool(met), "note": note}


@runtime_checkable
class RowListener(Protocol):
    """Progress that also wants to hear of rows."""

    def __call__(self, share: float) -> None:
        """So much is done."""

    def row(self, row: Mapping[str, object]) -> None:
        """A row is known."""


def report_rows_to(progress: Callable[[float], None], rows: Iterable[Mapping[str, object]], share: float) -> None:
    """Tell whoever follows the progress of rows that were just made, and the share 0 to 1 that is done with them."""
    if isinstance(progress, RowListener):
        for row in rows:
            progress.row(row)
    progress(share)


def within(progress: Callable[[float], None], first: float, last: float) -> Callable[[float], None]:
    """Progress of a part, 0 to 1, as progress of the whole from `first` to `last`."""
    return lambda share: progress(first + share * (last - first))


def two_digits(value: object) -> str:
    """A number to two significant digits, without an exponent where it can do without; "-" for None."""
    return "-" if value is None else f"{float(f'{float(str(value)):.2g}'):g}"
