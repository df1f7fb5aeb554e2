"""Which trained policies there are, for whoever needs one: the live rally, a rally that is played again."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, get_args

from app.workspace import Workspace
from core.errors import CommandError
from core.learning.policy import Policy
from core.learning.run_files import load_policy, seeds_of

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


def policy_of_run(workspace: Workspace, name: str, which: Literal["last", "best"] = "last") -> Policy:
    """The policy of a run, of its first seed.

    Raises:
        RallyscopeError: if there is no such run, or no policy in it that can be read.
    """
    if name not in workspace.run_names():
        raise CommandError("no such run", got=repr(name[:80]), remedy="choose one from the list")
    return load_policy(workspace.run_path(name), None, which)


def newest_seed(run: Path) -> int | None:
    """The seed whose policy was written last; None if there is no policy yet."""
    times = {seed: _changed_s(run / f"seed-{seed}" / "policy.safetensors") for seed in seeds_of(run)}
    return max(times, key=lambda seed: times[seed], default=None)


def _changed_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
