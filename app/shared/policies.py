"""Which trained policies there are, for whoever needs one: the live rally, a rally that is played again."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, get_args

from app.shared.workspace import Workspace

Player = Literal["training ball", "current policy", "best so far"]
PLAYERS: Final[tuple[Player, ...]] = get_args(Player)


def run_choices(workspace: Workspace) -> tuple[str, ...]:
    """Names of the runs that have a policy to play with, the newest first."""
    found = []
    for name in workspace.run_names():
        run = workspace.run_path(name)
        times = [_changed_s(path) for path in run.glob("seed-*/policy.safetensors")]
        if times:
            found.append((max(times), name))
    return tuple(name for _, name in sorted(found, reverse=True))


def _changed_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
