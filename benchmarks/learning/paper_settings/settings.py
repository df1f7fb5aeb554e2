"""The settings that are tried, their trainings, and how near they come to the paper's tables."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Final, Literal

from benchmarks.learning.plan import RULES, SLOW, Experiment, paper, stages
from benchmarks.learning.report import PAPER_BALLS, PAPER_RETURNS
from benchmarks.learning.runs import Results, SeedResult
from core.learning.config import DdpgConfig, EnvironmentConfig, GoalConfig, RewardConfig
from core.metrics.intervals import binomial_interval
from core.physics.config import Profile
from core.physics.task import RacketSpeedConfig, task_profile

Targets = Literal["point", "box", "half"]
Pace = Literal["four", "two"]
PHYSICS: Final[tuple[Profile, ...]] = ("paper", "real")
PITCHES_DEG: Final = (-8.0, 0.0, 4.0)
RACKET_SHARES: Final = (0.8, 1.0, 1.2)
"""Of the speeds that the task's table has."""
GOALS: Final[dict[Targets, GoalConfig]] = {
    "point": GoalConfig(kind="fixed"),
    "box": GoalConfig(),
    "half": GoalConfig(low_x_m=0.1, high_x_m=1.3, half_width_m=0.7),
}
PACES: Final[dict[Pace, DdpgConfig]] = {"four": DdpgConfig(), "two": SLOW}
SCREEN_SEED: Final = 300
"""Settings are chosen by seeds from here on, and judged by others."""
WORDS: Final[dict[Targets, str]] = {"point": "one point", "box": "our box", "half": "nearly the whole half"}


@dataclass(frozen=True, slots=True)
class Setting:
    """One way to settle what the paper leaves open."""

    physics: Profile
    pitch_deg: float
    """How far the racket's face is tilted up at action zero."""
    racket: float
    """Its speed, as a share of the table's."""
    targets: Targets
    pace: Pace
    """Updates per episode; `two` with both rates at 0.001."""

    @property
    def name(self) -> str:
        """Unique, and fit for a folder."""
        return f"{self.physics}-{self.pitch_deg:g}deg-{self.racket:g}x-{self.targets}-{self.pace}"

    @property
    def environment(self) -> EnvironmentConfig:
        """The task of the paper's agent, with the five-point prediction."""
        task = task_profile(self.physics)
        speeds = dataclasses.asdict(task.stroke.racket_speed)
        racket = RacketSpeedConfig(**{name: self.racket * speed for name, speed in speeds.items()})
        stroke = dataclasses.replace(task.stroke, base_pitch_deg=self.pitch_deg, racket_speed=racket)
        return EnvironmentConfig(task=dataclasses.replace(task, stroke=stroke), goal=GOALS[self.targets])

    def trainings(self, seeds: int, first_seed: int, *, whole: bool) -> list[Experiment]:
        """CDTA at 3 and 4 m/s and the curriculum with the threshold; `whole`: every reward and rule."""
        steps = {"3": stages((3.0,), (600,)), "4": stages((4.0,), (1000,))}
        rewards = ("simple", "case", "cdta") if whole else ("cdta",)
        found = {
            self.training(f"{speed}-{kind}"): paper(curriculum, reward=RewardConfig(kind=kind))
            for (speed, curriculum), kind in itertools.product(steps.items(), rewards)
        }
        rules = RULES if whole else ("threshold",)
        found |= {self.training(rule): paper(stages((3.0, 5.0), (800, 900), rule)) for rule in rules}
        return [
            Experiment(
                name,
                dataclasses.replace(
                    config,
                    environment=self.environment,
                    ddpg=PACES[self.pace],
                    seeds=seeds,
                    first_seed=first_seed,
                ),
            )
            for name, config in found.items()
        ]

    def training(self, what: str) -> str:
        """The name of one of its trainings: a speed and a reward, or a replay rule."""
        return f"{self.name}-{what}"


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure of the paper's agent, and between which bounds one like it lies."""

    title: str
    training: str
    """As `Setting.training` is asked for it."""
    value: float
    """Share returned, or the five best evaluations' error in mm."""
    episode: int | None = None
    """Of a return rate; None: an error at `speed_mps`."""
    speed_mps: float = 0.0

    def of_seed(self, result: SeedResult) -> float:
        """What a seed has for it; NaN if it did not get so far."""
        if self.episode is None:
            return result.five_best_mm(self.speed_mps)
        found = result.at(self.episode)
        return math.nan if found is None else found.returned

    @property
    def is_rate(self) -> bool:
        """Or an error."""
        return self.episode is not None

    @property
    def bounds(self) -> tuple[float, float]:
        """Wilson's interval of a rate of 50 balls; of an error, whose spread the paper does not say, a quarter."""
        return binomial_interval(self.value, PAPER_BALLS) if self.is_rate else (self.value / 1.25, self.value * 1.25)


FIGURES: Final = (
    *(
        PaperFigure(f"{speed} m/s, returned @{episode}", f"{speed}-cdta", cdta / 100, episode)
        for (speed, episode), (_, _, cdta) in PAPER_RETURNS.items()
    ),
    PaperFigure("4 m/s, error @1000", "4-cdta", 226.0, speed_mps=4.0),
    PaperFigure("3, then 5 m/s, error @1700", "threshold", 277.0, speed_mps=5.0),
)


@dataclass(frozen=True, slots=True)
class Nearness:
    """How near a setting comes to the paper."""

    values: tuple[float, ...]
    """Mean over seeds of each of FIGURES."""
    inside: int
    """How many of them lie within the paper's bounds."""
    distance: float
    """Mean over the figures of how far they lie from the paper's: 1 is 10 points, or a quarter of an error."""


def every_setting() -> tuple[Setting, ...]:
    """All that are tried."""
    return tuple(itertools.starmap(Setting, itertools.product(PHYSICS, PITCHES_DEG, RACKET_SHARES, GOALS, PACES)))


def nearness(setting: Setting, results: Results) -> Nearness | None:
    """How near its trainings come; None if some are missing."""
    values, inside, distance = [], 0, 0.0
    for figure in FIGURES:
        found = [figure.of_seed(result) for result in results[setting.training(figure.training)]]
        if not found or any(map(math.isnan, found)):
            return None
        value = sum(found) / len(found)
        low, high = figure.bounds
        values.append(value)
        inside += low <= value <= high
        distance += abs(value - figure.value) / 0.1 if figure.is_rate else abs(math.log(value / figure.value, 1.25))
    return Nearness(tuple(values), inside, distance / len(FIGURES))
