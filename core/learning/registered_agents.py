"""Registry of the agents that `rallyscope train` knows by name: ours, the rivals of stable-baselines3, and plug-ins'.

It loads without torch: a form or a table of runs needs the names only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from core.config import check_config_type
from core.errors import PluginError
from core.registry import Registry

AgentName = str
"""The name of an agent in `AGENTS`."""
MakeAgent = Callable[[Any, np.random.Generator], Any]
"""Of a `RunConfig`, which asks this registry for names, and a generator, an `Agent`."""


@dataclass(frozen=True, slots=True)
class RegisteredAgent:
    """An agent, as `register_agent` describes it."""

    label: str
    make: MakeAgent | None = None
    """None of ours: `core.learning.runs.training.make_agent` makes them, so that names load without torch."""
    config: type | None = None
    chooses_racket_speed: bool = False
    trains_itself: bool = False
    """Whether a library trains it in a loop of its own."""


AGENTS: Final[Registry[RegisteredAgent]] = Registry("agent", "rallyscope.agents")
"""Every agent by name."""


def agent_section(agent: str) -> str:
    """The name of the section with the settings of an agent."""
    return agent.replace("-", "_")


def register_agent(
    name: str, make: MakeAgent, label: str, *, config: type | None = None, chooses_racket_speed: bool = False
) -> None:
    """Add an agent: to `train --agent` and the form of the mode Train; its policies play in Watch as all others.

    Args:
        name: of the agent; with underscores it is the section of its settings.
        make: gives a new `core.learning.agents.agent.Agent` for a run's config and a generator, which is to be its only
            source of chance: a run that is resumed then gives the same numbers.
        label: what it is, in a line.
        config: its settings, a frozen dataclass with defaults; `agent_settings` finds them in a run's config.
        chooses_racket_speed: whether it gives actions (N, 4) where the run's racket speed is chosen.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"agent {name}"
    if not callable(make):
        raise PluginError("no way to make the agent", expected="make(config, rng)", where=where)
    if not isinstance(label, str) or not label.strip():
        raise PluginError("no label", expected="a line that says what it is", got=repr(label), where=where)
    if config is not None:
        check_config_type(config, where)
    AGENTS.register(name, RegisteredAgent(label, make, config, chooses_racket_speed))


AGENTS.register("ddpg", RegisteredAgent("the paper's: deep deterministic policy gradient"))
AGENTS.register("landing-model", RegisteredAgent("predicts where a ball will land", chooses_racket_speed=True))
for _name in ("ppo", "a2c", "trpo", "td3", "sac"):
    AGENTS.register(_name, RegisteredAgent(f"{_name.upper()} of stable-baselines3", trains_itself=True))
AGENTS.mark_built_in()
