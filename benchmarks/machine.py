"""What figures were measured on, and whether they are what was aimed at."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

Row = dict[str, object]


def describe_machine(*packages: str, **remarks: str) -> dict[str, object]:
    """Processor, load, and versions of Python and the named packages, with remarks such as the clock that was used."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if line[:10] == "model name"]
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
