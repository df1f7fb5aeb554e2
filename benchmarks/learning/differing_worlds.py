"""What domain randomisation costs at home and gains where the world differs, and what MuJoCo changes.

`python -m benchmarks.learning.differing_worlds --folder FOLDER --report PAGE.md --first-seed N`: the landing model at
5 m/s, trained at home and once for each thing that can differ from ball to ball. Seeds are kept in the folder and not
trained again.
"""

from __future__ import annotations

import argparse
import dataclasses
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.learning.plan import PROCESS, Experiment, stages
from benchmarks.learning.runs import (
    Evaluation,
    Results,
    SeedResult,
    load_results,
    missing_seeds,
    pair_by_seed,
    paired_difference,
    seeds_as_text,
    seeds_in_turn,
    shown,
    train_missing,
)
from benchmarks.machine import describe_machine, machine_words
from core.jobs import ALONE, open_jobs
from core.learning.config import EnvironmentConfig, RunConfig, default_run
from core.learning.evaluation.policy_evaluator import oracle_actions
from core.learning.randomisation import RANDOMISED, RandomisationConfig
from core.learning.task.environment import evaluation_balls, play
from core.text import markdown_table

SPEED_MPS: Final = 5.0
HOME, MUJOCO, RACKET, ALL = "home", "mujoco", "racket", "all four"
COMMAND: Final = "python -m benchmarks.learning.differing_worlds"
TEXT: Final = """The landing model as a Gaussian process, with states known exactly and physics `paper`, learns from
{episodes} balls at 5 m/s in the usual world, *at home*, and once for each row in a world that differs from ball to
ball: `train --agent landing-model --head process --speeds 5 --episodes {episodes} --randomise physics`, or `--racket
uncertain`. Ranges: `RandomisationConfig` in `core/learning/randomisation.py`; physics `paper` has no air, so drag does
not differ. Every last policy plays {balls} fixed balls at home and as many where the world differs (`evaluate RUN
--randomise physics`, or `none`). Seeds {seeds}, drawn when the code was done; rows pair them. Mean ± standard deviation
over seeds [95 % interval of the mean, Student's t]. A ball that the racket misses counts 2,740 mm. Nobody is told what
differs: trained there, a policy can only learn what is best on the average."""


def differing_environments(home: EnvironmentConfig) -> dict[str, EnvironmentConfig]:
    """The environments that differ from ball to ball, by the name of what does."""
    switched = {name: (name,) for name in RANDOMISED} | {ALL: RANDOMISED}
    found = {
        name: dataclasses.replace(home, randomise=RandomisationConfig(**dict.fromkeys(names, True)))
        for name, names in switched.items()
    }
    return found | {RACKET: dataclasses.replace(home, racket="uncertain")}


def trainings(first_seed: int, seeds: int, episodes: int, balls: int) -> tuple[Experiment, ...]:
    """One at home, which is also evaluated everywhere else, and one for each environment, evaluated at home."""
    base = default_run("landing-model")
    home = base.environment
    mujoco = dataclasses.replace(home, engine="mujoco")
    elsewhere = differing_environments(home) | {MUJOCO: mujoco}
    config = dataclasses.replace(
        base,
        landing_model=PROCESS,
        curriculum=stages((SPEED_MPS,), (episodes,), "retain"),
        checkpoint_every=episodes,
        evaluation_balls=balls,
        seeds=seeds,
        first_seed=first_seed,
    )

    def trained(environment: EnvironmentConfig) -> RunConfig:
        return dataclasses.replace(config, environment=environment)

    return (
        Experiment(HOME, config, tuple(elsewhere.items())),
        *(Experiment(name, trained(environment), ((HOME, home),)) for name, environment in elsewhere.items()),
    )


def run(folder: Path, experiments: Sequence[Experiment]) -> Results:
    """Train what is missing, a seed of every experiment before the next seed, and load all."""
    pieces = missing_seeds(seeds_in_turn(experiments), folder)
    with open_jobs(ALONE, len(pieces)) as jobs:
        train_missing(jobs, pieces, folder, lambda share: None)
    return load_results(experiments, folder)


def differing_tables(results: Results) -> list[str]:
    """Errors and return rates of policies trained at home and in the differing world, in both."""
    errors, rates = [], []
    for name in (*RANDOMISED, ALL, RACKET):
        usual, own = results[HOME], results[name]
        cost, gain = (_difference(own, usual, where, name) for where in (HOME, name))
        figures = [[_shown(side, where, name, what) for where in (HOME, name) for side in (usual, own)]
                   for what in ("error_mm", "returned")]  # fmt: skip
        errors.append([name, *figures[0][:2], cost, *figures[0][2:], gain])
        rates.append([name, *figures[1]])
    titles = ("trained at home, at home", "trained there, at home", "trained at home, there", "trained there, there")
    error_titles = ("differs", *titles[:2], "costs at home", *titles[2:], "changes there")
    return [
        "## Distance from the target, mm\n",
        markdown_table(error_titles, errors),
        "*Costs*, *changes*: trained there less trained at home, paired; negative is better.\n",
        "## Returned, %\n",
        markdown_table(("differs", *titles), rates),
    ]


def _evaluated(found: Sequence[SeedResult], where: str, trained: str) -> dict[int, Evaluation]:
    """The last policy of each seed in an environment: its own, or one that it was carried to."""
    own = {result.seed: result.evaluations[-1] for result in found}
    carried = {result.seed: result.transfers[where] for result in found if where in result.transfers}
    return carried if where != trained and carried else own


def _shown(found: Sequence[SeedResult], where: str, name: str, what: str) -> str:
    trained = HOME if any(name in result.transfers for result in found) else name
    return shown(what, [getattr(one, what) for one in _evaluated(found, where, trained).values()])


def _difference(own: Sequence[SeedResult], usual: Sequence[SeedResult], where: str, name: str) -> str:
    """Paired difference of the errors in an environment, mm."""
    sides = [{seed: one.error_mm for seed, one in _evaluated(*of).items()}
             for of in ((own, where, name), (usual, where, HOME))]  # fmt: skip
    _, ours, theirs = pair_by_seed(*sides, where=name)
    found = paired_difference(ours, theirs)
    return f"{found.estimate:+.1f} [{found.low:+.1f}, {found.high:+.1f}]"


def mujoco_section(results: Results, balls: int) -> list[str]:
    """The same strokes in both simulators, and policies carried from one to the other."""
    home = default_run("landing-model").environment
    drawn = evaluation_balls(SPEED_MPS, balls, home)
    actions = oracle_actions(drawn, home)
    play(drawn[:1], actions[:1], dataclasses.replace(home, engine="mujoco"))  # loads and compiles
    outcomes, took_ms = [], []
    for engine in ("closed-form", "mujoco"):
        started = time.process_time()
        outcomes.append(play(drawn, actions, dataclasses.replace(home, engine=engine)))
        took_ms.append(1e3 * (time.process_time() - started) / balls)
    off_mm = 1e3 * np.hypot(*(outcomes[0].landings_m - outcomes[1].landings_m).T)
    same = 100 * float(np.mean(outcomes[0].case == outcomes[1].case))
    policies = [
        [f"in {words}", *(_shown(results[name], where, MUJOCO, "error_mm") for where in (HOME, MUJOCO))]
        for words, name in (("closed form", HOME), ("MuJoCo", MUJOCO))
    ]
    return [
        "## MuJoCo\n",
        textwrap.fill(
            f"`--simulator mujoco` against closed form. {balls} fixed balls, the best stroke of each: same case for "
            f"{same:.1f} %, landings {np.nanmedian(off_mm):.2g} mm apart (median; {np.nanmax(off_mm):.2g} at most). "
            f"Processor time a ball: {took_ms[1]:.1f} ms in MuJoCo (10 ms steps), {1e3 * took_ms[0]:.2g} us in closed "
            "form. Policies, mm from the target:",
            118,
        )
        + "\n",
        markdown_table(("trained", "played in closed form", "played in MuJoCo"), policies),
    ]


def main() -> None:
    """Train, measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="trained seeds are kept here")
    parser.add_argument("--report", type=Path, required=True, help="the page that is written")
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--balls", type=int, default=200, help="of each evaluation")
    asked = parser.parse_args()
    experiments = trainings(asked.first_seed, asked.seeds, asked.episodes, asked.balls)
    results = run(asked.folder, experiments)
    seeds = seeds_as_text(result.seed for result in results[HOME])
    command = f"{COMMAND} --folder FOLDER --report PAGE.md --first-seed {asked.first_seed} --seeds {asked.seeds}"
    machine = machine_words(describe_machine("numpy", "torch", "mujoco", clock="processor time of one thread"))
    text = TEXT.format(episodes=asked.episodes, balls=asked.balls, seeds=seeds)
    parts = [
        "# Where the world differs\n",
        f"Made by `{command}` ({machine}).\n",
        textwrap.fill(text, 118) + "\n",
        *differing_tables(results),
        *mujoco_section(results, asked.balls),
    ]
    asked.report.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
