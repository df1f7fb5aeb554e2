"""Runs with a name: the paper's agent; the same rules with changes of ours against its
unsteadiness; and one of ours that is the same DDPG without the paper's rules.

How far they land from the target is measured by `python -m benchmarks.learning.ablation`.
"""

from __future__ import annotations

from typing import Final, Literal

from core.learning.config import (
    CurriculumConfig,
    DdpgConfig,
    EnvironmentConfig,
    ExplorationConfig,
    RewardConfig,
    RunConfig,
    default_run,
)


def _steady() -> RunConfig:
    """The paper's curriculum, reward, replay rule, exploration and perception; the rest is ours.

    The paper leaves open how wide the networks are and how fast and often they learn. Not in the paper: rewards
    recomputed with the present weights, rates that fall, and a penalty at the edge of the action range.
    """
    ddpg = DdpgConfig(
        hidden=128,
        actor_rate=1e-3,
        updates_per_episode=8,
        batch=32,
        rewards="current",
        final_rate=0.3,
        edge_penalty=1.0,
    )
    return RunConfig(ddpg=ddpg)


def _placing() -> RunConfig:
    """Without the paper's rules: 5 m/s only, true states, placing counts from the first ball, each has four targets.

    Half the width and half the updates take less than half the time, and land twice as far from the target.
    """
    return RunConfig(
        environment=EnvironmentConfig(state_source="truth"),
        reward=RewardConfig(kind="case", case_weight=0.0),
        exploration=ExplorationConfig(random_episodes=32),
        curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(1700,), replay="retain"),
        ddpg=DdpgConfig(
            hidden=128,
            batch=32,
            updates_per_episode=8,
            relabels=3,
            actor_rate=1e-3,
            critic_rate=2e-3,
            final_rate=0.1,
        ),
    )


PresetName = Literal["paper", "steady", "placing"]
NAMED_RUNS: Final[dict[PresetName, RunConfig]] = {
    "paper": default_run("ddpg"),
    "steady": _steady(),
    "placing": _placing(),
}
"""Every named run."""
