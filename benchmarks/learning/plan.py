"""Which trainings the report on learning is made of: every comparison that the paper makes, and those it leaves out."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from core.learning.config import (
    CurriculumConfig,
    DdpgConfig,
    EnvironmentConfig,
    ExplorationConfig,
    LandingModelConfig,
    ReplayRule,
    RewardConfig,
    RunConfig,
    Sb3Config,
    default_run,
    environment_profile,
)
from core.learning.registered_agents import AgentName
from core.learning.rewards import RewardKind

Exploration = Literal["default", "matched"]
EXPLORATIONS: tuple[Exploration, ...] = ("default", "matched")
RIVALS: tuple[AgentName, ...] = ("ppo", "a2c", "trpo", "td3", "sac")
REWARDS: tuple[RewardKind, ...] = ("simple", "case", "cdta")
MINOR = ("model-hard-9", "model-shaky", "model-biased", "model-privileged")
MINOR += ("model-climb-discard", "model-impact", "model-flight", "model-predicted", "model-hard-noisy-climb")
RULES: tuple[ReplayRule, ...] = ("threshold", "discard", "retain")
SLOW = DdpgConfig(updates_per_episode=2, actor_rate=1e-3, critic_rate=1e-3)
"""The paper's pace."""
IMPACT = LandingModelConfig(head="impact", critic_rate=3e-4, actor_rate=3e-3, final_rate=0.1)
"""What the model is told of physics leaves it little to learn, and noise less to spoil: a slow critic."""
PROCESS = LandingModelConfig(head="process")
REFLECTION = LandingModelConfig(head="reflection")


@dataclass(frozen=True, slots=True)
class Counts:
    """How much is run: the full report, or a smoke test of the same code."""

    seeds: int = 20
    """Of everything that is compared, rivals included: both sides of a claim have the same seeds."""
    minor_seeds: int = 10
    """Of variants that no figure is aimed at and nothing is claimed of."""
    balls: int = 500
    shorten: int = 1
    """Divides the episodes of every stage."""
    event_seeds: int = 5
    """Of the training before event cameras."""
    event_balls: int = 200
    """That each of them is evaluated on there."""
    event_episodes: int = 150
    people_balls: int = 100
    """Of human play, that each of as many policies is evaluated on there."""
    claim_seeds: int = 40
    """Of the paper's claims, which have seeds of their own."""


def counts_of(seeds: int) -> Counts:
    """The full report with another number of seeds, and no more of what has fewer."""
    full = Counts()
    return dataclasses.replace(
        full,
        seeds=seeds,
        minor_seeds=min(seeds, full.minor_seeds),
        event_seeds=min(seeds, full.event_seeds),
        claim_seeds=seeds,
    )


@dataclass(frozen=True, slots=True)
class Experiment:
    """One configuration, trained with several seeds."""

    name: str
    """Unique; the folder of its results."""
    config: RunConfig
    transfers: tuple[tuple[str, EnvironmentConfig], ...] = ()
    """Other environments that the last policy is also evaluated in, by name."""


def plan(counts: Counts) -> tuple[Experiment, ...]:
    """All trainings, the most wanted first."""
    wanted = [
        *_rewards("3", stages((3.0,), (600,)), DdpgConfig()),
        *_rewards("4", stages((4.0,), (1000,)), DdpgConfig()),
        *_rewards("slow-3", stages((3.0,), (600,)), SLOW),
        *_rewards("slow-4", stages((4.0,), (1000,)), SLOW),
        *_replay_rules(),
        *_landing_model(),
        *_better(),
        *_rivals(),
    ]
    return tuple(_scaled(experiment, counts) for experiment in wanted)


def stages(speeds: Sequence[float], episodes: Sequence[int], replay: ReplayRule = "threshold") -> CurriculumConfig:
    """Stages of so many episodes."""
    return CurriculumConfig(speeds_mps=tuple(speeds), episodes=tuple(episodes), replay=replay)


def paper(curriculum: CurriculumConfig, **changes: object) -> RunConfig:
    """The paper's agent with the paper's perception."""
    return RunConfig(curriculum=curriculum, **changes)  # type: ignore[arg-type]


def _rewards(name: str, curriculum: CurriculumConfig, ddpg: DdpgConfig) -> list[Experiment]:
    return [
        Experiment(f"reward-{name}-{kind}", paper(curriculum, reward=RewardConfig(kind=kind), ddpg=ddpg))
        for kind in REWARDS
    ]


def _replay_rules() -> list[Experiment]:
    steps = (800, 900)
    found = [Experiment(f"replay-{rule}", paper(stages((3.0, 5.0), steps, rule))) for rule in RULES]
    return [*found, Experiment("replay-scratch", paper(stages((5.0,), (1700,))))]


def _landing_model() -> list[Experiment]:
    base = default_run("landing-model")
    truth = base.environment
    shaky = dataclasses.replace(truth, actuator_error_deg=1.0)
    biased = dataclasses.replace(truth, actuator_bias_deg=1.0)
    noisy_hard = environment_profile(serves="hard", state_source="truth+noise")
    hard = environment_profile(serves="hard", state_source="truth")
    climb = (5.0, 6.0, 7.0, 8.0, 9.0)

    def model(
        name: str, curriculum: CurriculumConfig, environment: EnvironmentConfig = truth, **more: object
    ) -> Experiment:
        config = dataclasses.replace(base, curriculum=curriculum, environment=environment)
        return Experiment(f"model-{name}", dataclasses.replace(config, **more))  # type: ignore[arg-type]

    straight = model("5", stages((5.0,), (1700,)))
    return [
        dataclasses.replace(straight, transfers=(("1 degree of random error", shaky), ("1 degree of bias", biased))),
        model("climb-retain", stages(climb, (100,) * 5, "retain")),
        model("climb-discard", stages(climb, (100,) * 5, "discard")),
        model("hard-noisy-5", stages((5.0,), (200,)), noisy_hard),
        model("hard-noisy-9", stages((9.0,), (200,)), noisy_hard),
        model("hard-noisy-climb", stages(climb, (200,) * 5, "retain"), noisy_hard),
        model("hard-9", stages((9.0,), (200,)), hard),
        model("shaky", stages((5.0,), (300,)), shaky),
        model("biased", stages((5.0,), (300,)), biased),
        model("flight-5", stages((5.0,), (300,)), landing_model=LandingModelConfig(head="flight")),
        model("impact-5", stages((5.0,), (300,)), landing_model=IMPACT),
        model("impact-hard-noisy-5", stages((5.0,), (200,)), noisy_hard, landing_model=IMPACT),
        model("impact-hard-noisy-9", stages((9.0,), (200,)), noisy_hard, landing_model=IMPACT),
        model("process-5", stages((5.0,), (300,)), landing_model=PROCESS),
        model("process-hard-noisy-5", stages((5.0,), (200,)), noisy_hard, landing_model=PROCESS),
        model("process-hard-noisy-9", stages((9.0,), (200,)), noisy_hard, landing_model=PROCESS),
        model("reflection-5", stages((5.0,), (300,)), landing_model=REFLECTION),
        model("reflection-hard-noisy-5", stages((5.0,), (200,)), noisy_hard, landing_model=REFLECTION),
        model("reflection-hard-noisy-9", stages((9.0,), (200,)), noisy_hard, landing_model=REFLECTION),
        model("reflection-shaky", stages((5.0,), (300,)), shaky, landing_model=REFLECTION),
        model("privileged", stages((5.0,), (100,)), landing_model=LandingModelConfig(privileged=True)),
        model("predicted", stages((5.0,), (100,)), dataclasses.replace(truth, state_source="predicted")),
    ]


def _better() -> list[Experiment]:
    """The paper's agent with what improves it."""
    better = DdpgConfig(updates_per_episode=16, relabels=3, batch=32, actor_rate=1e-3, critic_rate=2e-3)
    config = paper(
        stages((5.0,), (300,)),
        ddpg=better,
        reward=RewardConfig(kind="case", case_weight=0.0),
        environment=EnvironmentConfig(state_source="truth"),
        exploration=ExplorationConfig(random_episodes=30),
    )
    return [Experiment("better-300", config)]


def _rivals() -> list[Experiment]:
    found = {}
    for name, curriculum in (
        ("5", stages((5.0,), (1700,), "retain")),
        ("4", stages((4.0,), (1000,), "retain")),
        ("ladder", stages((3.0, 5.0), (800, 900), "retain")),
    ):
        for exploration in EXPLORATIONS:
            for agent in RIVALS:
                rival = Sb3Config(exploration=exploration)
                config = dataclasses.replace(default_run(agent), curriculum=curriculum, rival=rival)
                found[rival_training(name, exploration, agent)] = config
    return [Experiment(name, config) for name, config in found.items()]


def rival_training(name: str, exploration: Exploration, agent: AgentName) -> str:
    """The experiment of a rival. TD3's default exploration and rate are the matched ones: it is trained once."""
    return f"rival-{name}-{'matched' if agent == 'td3' else exploration}-{agent}"


def is_minor(experiment: Experiment) -> bool:
    """Whether no figure is aimed at it."""
    return experiment.name.startswith(MINOR)


def _scaled(experiment: Experiment, counts: Counts) -> Experiment:
    config = experiment.config
    episodes = tuple(max(2, n // counts.shorten) for n in config.curriculum.episodes)
    seeds = counts.minor_seeds if is_minor(experiment) else counts.seeds
    config = dataclasses.replace(
        config,
        curriculum=dataclasses.replace(config.curriculum, episodes=episodes),
        checkpoint_every=max(1, 50 // counts.shorten),
        evaluation_balls=counts.balls,
        seeds=seeds,
    )
    return dataclasses.replace(experiment, config=config)
