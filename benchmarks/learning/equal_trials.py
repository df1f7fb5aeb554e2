"""One protocol of tuning for the paper's agent and its rivals: as many trials, the same seeds and the same objective.

    python -m benchmarks.learning.equal_trials [--folder DIR]

The first trial is an agent as it was before; the others are the same draws for every agent. The best has the lowest
geometric mean, over the seeds, of the error after 1,700 balls. `tuned.toml` has what came of it, and the claims on
drawn seeds are about the best of each. An interrupted tuning goes on where it was.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import tomli_w

from benchmarks.learning.plan import RIVALS, Counts, Experiment, plan, rival_training
from benchmarks.learning.runs import Results, load_results, missing_seeds, seeds_in_turn, train_missing, values_at_end
from core.jobs import HERE, open_jobs
from core.learning.config import RunConfig, Sb3Config
from core.learning.registered_agents import AgentName
from core.text import markdown_table

FOLDER: Final = Path("rallyscope-data/equal-trials")
TUNED: Final = Path(__file__).with_name("tuned.toml")
TRIALS: Final = 12
SEEDS: Final = 2
FIRST_SEED: Final = 51_000
"""No other training has these seeds."""
SPEED_MPS: Final = 5.0
OURS: Final[AgentName] = "ddpg"
TUNED_AGENTS: Final[tuple[AgentName, ...]] = (OURS, *RIVALS)
EQUAL_STEPS: Final[tuple[AgentName, ...]] = ("td3", "sac", "ppo")
"""Rivals that take as many gradient steps after each ball as the paper's agent; the others have one step from each set
of balls."""
ACTOR_SHARE: Final = 0.1
"""Of the critic's rate, the actor's of the paper's agent: as in its default."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What is tuned of every agent."""

    rate: float
    """Learning rate; of the paper's agent the critic's."""
    noise: float
    """Standard deviation of the first exploration, in units of the action range."""
    hidden: int
    """Units of both hidden layers."""
    balls: int
    """Between two updates of PPO and TRPO; the other agents have no such setting."""


def draw_trials(count: int = TRIALS - 1) -> list[Trial]:
    """The trials after the first: rates and noises evenly on a logarithmic scale."""
    rng = np.random.default_rng(FIRST_SEED)
    return [
        Trial(
            float(f"{10 ** rng.uniform(-3.5, -2):.2g}"),
            float(f"{0.05 * 8 ** rng.uniform():.2g}"),
            int(rng.choice((64, 128, 256))),
            int(rng.choice((10, 25, 50, 100))),
        )
        for _ in range(count)
    ]


def untuned(counts: Counts) -> dict[AgentName, RunConfig]:
    """The first trial of every agent: all after the same balls with the same noise, and as many steps where it can."""
    planned = {one.name: one.config for one in plan(counts)}
    paper, rival = planned["replay-threshold"], planned[rival_training("5", "matched", "td3")]
    found: dict[AgentName, RunConfig] = {OURS: paper}
    for agent in RIVALS:
        updates = paper.ddpg.updates_per_episode if agent in EQUAL_STEPS else 0
        found[agent] = replace(
            rival, agent=agent, rival=Sb3Config(exploration="matched", updates_per_episode=updates)
        )  # fmt: skip
    return found


def with_trial(config: RunConfig, trial: Trial) -> RunConfig:
    """The same run with what a trial changes."""
    config = replace(config, exploration=replace(config.exploration, scale=trial.noise))
    if config.agent == OURS:
        rates = {"critic_rate": trial.rate, "actor_rate": ACTOR_SHARE * trial.rate}
        return replace(config, ddpg=replace(config.ddpg, hidden=trial.hidden, **rates))
    rival = replace(config.rival, rate=trial.rate, hidden=trial.hidden, on_policy_steps=trial.balls)
    return replace(config, rival=rival)


def tuned(counts: Counts, path: Path = TUNED) -> dict[AgentName, RunConfig]:
    """Every agent with the best of its trials."""
    best = _best_trials(path)
    return {
        agent: config if (trial := best[agent].trial) is None else with_trial(config, trial)
        for agent, config in untuned(counts).items()
    }


def tuning_table(path: Path = TUNED) -> str:
    """A row per agent: its error without tuning and with its best trial, on the seeds tuned on, and that trial."""
    rows = []
    for agent, best in _best_trials(path).items():
        settings = ["as it was", "", "", ""]
        if (trial := best.trial) is not None:
            balls = str(trial.balls) if agent in ("ppo", "trpo") else ""
            settings = [f"{trial.rate:g}", f"{trial.noise:g}", str(trial.hidden), balls]
        name = "the paper's agent" if agent == OURS else agent.upper()
        rows.append([name, f"{best.first_mm:.0f}", f"{best.error_mm:.0f}", *settings])
    titles = ("agent", "first trial, mm", "best, mm", "its rate", "noise", "units", "balls between updates")
    return markdown_table(titles, rows)


class _Best(NamedTuple):
    """Of an agent the trial with the lowest error, None for the first; its error and the first one's."""

    trial: Trial | None
    error_mm: float
    first_mm: float


def _best_trials(path: Path) -> dict[AgentName, _Best]:
    found = tomllib.loads(path.read_text(encoding="utf-8"))
    trials = [None, *(Trial(**drawn) for drawn in found["trials"])]
    best = {}
    for agent in TUNED_AGENTS:
        errors_mm = found["error_mm"][agent]
        number = int(np.argmin(errors_mm))
        best[agent] = _Best(trials[number], errors_mm[number], errors_mm[0])
    return best


def experiments(counts: Counts) -> dict[AgentName, tuple[Experiment, ...]]:
    """All trials of every agent, in order."""
    found = {}
    for agent, config in untuned(counts).items():
        configs = [config, *(with_trial(config, trial) for trial in draw_trials())]
        found[agent] = tuple(
            Experiment(f"trial-{agent}-{number}", replace(one, seeds=SEEDS, first_seed=FIRST_SEED))
            for number, one in enumerate(configs)
        )
    return found


def errors_of(trials: Mapping[AgentName, tuple[Experiment, ...]], results: Results) -> dict[str, list[float]]:
    """The geometric mean over seeds of the error in mm at the end of every trial."""
    found = {}
    for agent, ones in trials.items():
        ends = [values_at_end(results[one.name], SPEED_MPS, "error_mm") for one in ones]
        found[agent] = [round(float(np.exp(np.mean(np.log(values)))), 2) for values in ends]
    return found


def run(folder: Path, path: Path = TUNED, counts: Counts | None = None) -> None:
    """Train what is missing, and write what came of all trials."""
    trials = experiments(counts or Counts())
    every = [one for ones in trials.values() for one in ones]
    pieces = missing_seeds(seeds_in_turn(every), folder)
    if pieces:
        with open_jobs(HERE, len(pieces)) as jobs:
            train_missing(jobs, pieces, folder, lambda share: print(f"{share:.1%}", flush=True))
    errors_mm = errors_of(trials, load_results(every, folder))
    write_tuned(path, errors_mm)


def write_tuned(path: Path, errors_mm: Mapping[str, list[float]]) -> None:
    """Write the draws, and the error of every trial of every agent."""
    written = tomli_w.dumps({"trials": [asdict(trial) for trial in draw_trials()], "error_mm": errors_mm})
    path.write_text(f"# Written by python -m benchmarks.learning.equal_trials\n\n{written}", encoding="utf-8")


def main() -> None:
    """Read the arguments, tune, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    run(parser.parse_args().folder)
    print(tuning_table())


if __name__ == "__main__":
    main()
