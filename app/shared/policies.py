"""Trained policies that can play the live rally or replay balls."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, get_args

from app.shared.live_rally import LiveRally
from app.shared.workspace import Workspace
from core.chain.control.controller import BuiltInController
from core.chain.control.policy_controller import load_controller
from core.errors import CommandError
from core.online_learning.controller import NAME
from core.online_learning.start import NOTHING, LearningStart, can_start_from, start_from_nothing, start_from_run

Player = Literal["training ball", "current policy", "best so far"]
PLAYERS: Final[tuple[Player, ...]] = get_args(Player)
BUILT_IN: Final = BuiltInController().name
LEARNS: Final = NAME


def run_choices(workspace: Workspace) -> tuple[str, ...]:
    """Names of the runs with a policy, newest first."""
    found = []
    for name in workspace.run_names():
        run = workspace.run_path(name)
        times = [_changed_s(path) for path in run.glob("seed-*/policy.safetensors")]
        if times:
            found.append((max(times), name))
    return tuple(name for _, name in sorted(found, reverse=True))


def has_policy(workspace: Workspace, name: str) -> bool:
    """Whether a run has a policy."""
    return any(workspace.run_path(name).glob("seed-*/policy.safetensors"))


def let_play(live: LiveRally, workspace: Workspace, name: str) -> None:
    """Let the built-in controller, the policy that learns, or that of a run play the live rally from the next block on.

    It aims where the one before it aimed. Reads a file: not to be called by the loop.

    Raises:
        RallyscopeError: if there is no such run, or its policy cannot be read.
    """
    goal = live.player.snapshot.goal_m
    if name == BUILT_IN:
        live.player.use(BuiltInController().aimed_at(goal))
    elif name == LEARNS:
        live.learning.begin()
    elif name in run_choices(workspace):  # never a path made from what a browser sent
        controller = load_controller(workspace.run_path(name), goal_m=goal)
        if controller.needs_spin and not live.player.config.chain.estimates_spin:
            remedy = "use the filter, or a policy trained without --state spin"
            raise CommandError("this policy needs the ball's spin, which the chain does not estimate", remedy=remedy)
        live.player.use(controller)
    else:
        raise CommandError("no policy to play with", got=repr(name[:80]), remedy="train one in the mode Train")


def start_choices(workspace: Workspace) -> tuple[str, ...]:
    """Starting points for online learning: untrained, or a run that can be resumed, newest first."""
    return (NOTHING, *(name for name in run_choices(workspace) if can_start_from(workspace.run_path(name))))


def learning_start(workspace: Workspace, name: str) -> LearningStart:
    """Load a starting point. Reads files: not to be called by the loop.

    Raises:
        RallyscopeError: if there is no such run, or it cannot be gone on with.
    """
    if name == NOTHING:
        return start_from_nothing()
    if name not in run_choices(workspace):  # never a path made from what a browser sent
        raise CommandError("no run to start from", got=repr(name[:80]), remedy="train one in the mode Train")
    return start_from_run(workspace.run_path(name))


def _changed_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
