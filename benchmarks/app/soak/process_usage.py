"""What a process holds: memory, threads, open files. Read from /proc, so on Linux only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from core.errors import CommandError

PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class ProcessUsage:
    """One process at one time."""

    resident_mb: float
    """Memory that belongs to it alone: what it shares with others, such as libraries and files, is not counted."""
    threads: int
    handles: int
    """Open files, sockets and pipes."""


def usage_of(pid: int) -> ProcessUsage:
    """Memory, threads and files of a running process.

    Raises:
        CommandError: if it is not, or this is not Linux.
    """
    try:
        status = _numbers(PROC / str(pid) / "status")
        return ProcessUsage(status["RssAnon"] / 1e3, status["Threads"], len(list((PROC / str(pid) / "fd").iterdir())))
    except (OSError, KeyError) as error:
        raise CommandError("cannot see what a process holds", expected="one that runs, on Linux", got=pid) from error


def children_of(pid: int) -> tuple[int, ...]:
    """Processes that this one started itself and that still run."""
    listed = [task / "children" for task in (PROC / str(pid) / "task").iterdir()]
    return tuple(int(child) for path in listed if path.exists() for child in path.read_text().split())


def _numbers(path: Path) -> dict[str, int]:
    """The lines NAME: NUMBER [kB]."""
    pairs = (line.partition(":") for line in path.read_text().splitlines())
    return {name: int(value.split()[0]) for name, _, value in pairs if value.split() and value.split()[0].isdigit()}
