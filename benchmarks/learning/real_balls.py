"""Balls that spin, and balls of human play, in the physics called real: which trainings, and what stands beside them.

Beside every policy, on the same balls: the built-in controller, which is told the ball and solves for the stroke, and
the best stroke within the policy's own bounds, found through the simulator itself.
"""

from __future__ import annotations

import dataclasses
import math
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.learning.plan import Counts, Experiment
from benchmarks.learning.runs import (
    Evaluation,
    PlayedSeed,
    PlayedTraining,
    Results,
    SeedResult,
    fingerprint,
    load_played,
    shown,
    values_at,
)
from core.chain.control.controller import BuiltInController
from core.files import read_json, write_json
from core.learning.config import (
    CHOSEN_MPS,
    SPINNING_RADPS,
    CurriculumConfig,
    EnvironmentConfig,
    LandingModelConfig,
    RunConfig,
    default_run,
    environment_profile,
    spinning_environment,
)
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, PolicyScore, landing_errors_mm, oracle_actions
from core.learning.runs.summary import spread_of
from core.learning.task.environment import ServeBatch
from core.learning.task.recorded_balls import ball_state_files
from core.physics.episode import strokes_from_actions
from core.simulation.episodes.closed_form import return_balls
from core.text import markdown_table

PREFIX: Final = "real-"
HEADING: Final = "## Real balls"
SEEDS: Final = 5
WITHIN_RADPS: Final = round(SPINNING_RADPS / math.sqrt(3), 1)
"""About each axis, so that the whole spin is within `SPINNING_RADPS`."""
SPEED_MPS: Final = 5.0
SPIN_EPISODES, HUMAN_EPISODES = 300, 1000
HUMAN_BALLS: Final = 1000
"""Test flights of human play that are played at each evaluation."""
MODEL: Final = LandingModelConfig(head="impact", actor_rate=3e-3, net_margin_m=0.05, net_weight=10.0)
"""Chosen with seed 100, by validation balls: the free and the flight head learned more slowly, a slow critic was no
better, and a margin of 2 cm at the net of weight 4 lost 2 of 100 balls."""
SEEN: Final = "human-seen"
SEEN_TITLE: Final = "before the event cameras"
NOTE: Final = """Physics `real`: drag, Magnus force, the measured table and rubber. The policy chooses three angles
and the racket's speed ({low:g} to {high:g} m/s; `--racket chosen`): with the one speed of the table that goes with 5
m/s not even perfect knowledge returns every spinning serve (its row). State `spin`: p_c, v_c, the spin at the racket
and its standard deviations, here known exactly but where another source is named. The landing model is told the law
of reflection, not its numbers. {spin:g} rad/s about each axis are up to {most:.0f} altogether, so there are two
tables. *Human play*: recorded states of {flights}; the flights are split 70, 10 and 20 % into training, validation
and test, in blocks of 50 that follow one another, so no flight and hardly a rally is on two sides. Figures are of
test balls and the last policy of each seed, mean ± standard deviation over seeds [95 % interval of the mean,
Student's t]; targets are random. *Built-in*: the controller that is told the ball exactly, from -2.5 to 4.5 m/s.
*Limit*: for each ball the best stroke within the policy's bounds that a search through the simulator finds. Both have
no seeds. *Before the event cameras*: policies that were trained in closed form on states with noise of 5 mm, 1 % and
up to 20 rad/s play {seen} test balls, drawn from all and the same for every seed, in the simulated world to their end;
detection, stereo and prediction give the state, and nobody is told how balls fly.
"""
GOAL_NOTE: Final = "*Reached*: the whole interval over seeds is within the bound; *the mean alone*, if only that.\n"


@dataclass(frozen=True, slots=True)
class RealRow:
    """A training of the section, and the figures that it is to reach."""

    name: str
    title: str
    config: RunConfig
    returned: float | None = None
    error_mm: float | None = None
    median_mm: float | None = None
    is_seen: bool = False
    """Whether its policies are played out before event cameras."""


def real_rows(recorded: str | None) -> list[RealRow]:
    """The trainings; those of human play only if there are recorded balls, a file or a folder."""
    real = environment_profile("real", state_source="truth")
    chosen = dataclasses.replace(spinning_environment(real), state="spin", racket="chosen")
    replace = dataclasses.replace
    noisy = replace(chosen, state_source="truth+noise")
    less = replace(spinning_environment(real, WITHIN_RADPS), state="spin", racket="chosen")
    rows = [
        RealRow("spin", "state `spin`", _run(chosen, SPIN_EPISODES), 0.99, error_mm=60),
        RealRow("within", "state `spin`", _run(less, SPIN_EPISODES), 0.99, error_mm=60),
    ]
    unknown = "state `plain`: the spin is not known"
    if recorded:
        human = replace(real, state="spin", racket="chosen", recorded=recorded)
        plain, uncertain = replace(human, state="plain"), replace(human, state_source="truth+noise")
        rows += [
            RealRow("human", "state `spin`", _run(human, HUMAN_EPISODES, HUMAN_BALLS), 0.97, median_mm=120),
            RealRow("human-plain", unknown, _run(plain, HUMAN_EPISODES, HUMAN_BALLS)),
            RealRow(SEEN, SEEN_TITLE, _run(uncertain, HUMAN_EPISODES), 0.95, error_mm=200, is_seen=True),
        ]
    rows += [
        RealRow("spin-plain", unknown, _run(replace(chosen, state="plain"), SPIN_EPISODES)),
        RealRow("spin-noisy", "`spin`, noise 5 mm, 1 %, 0 to 20 rad/s", _run(noisy, SPIN_EPISODES)),
    ]
    return rows


def real_experiments(counts: Counts, recorded: str | None) -> tuple[Experiment, ...]:
    """The trainings on recorded balls as experiments of the bench."""
    rows = [row for row in real_rows(recorded) if not row.is_seen]
    return tuple(Experiment(PREFIX + row.name, _scaled(row.config, counts)) for row in rows)


def seen_people(counts: Counts, recorded: str | None) -> PlayedTraining | None:
    """Balls of human play before event cameras, by a chain that is told nothing; None without recorded balls."""
    row = next((row for row in real_rows(recorded) if row.is_seen), None)
    if row is None:
        return None
    config = _scaled(row.config, counts)
    return PlayedTraining(PREFIX + row.name, config, counts.event_seeds, counts.people_balls, told=False)


def _scaled(config: RunConfig, counts: Counts) -> RunConfig:
    episodes = max(2, config.episodes // counts.shorten)
    return dataclasses.replace(
        config,
        curriculum=dataclasses.replace(config.curriculum, episodes=(episodes,)),
        checkpoint_every=max(1, 100 // counts.shorten),
        evaluation_balls=min(config.evaluation_balls, 2 * counts.balls),
        seeds=min(SEEDS, counts.seeds),
    )


def real_balls_section(
    experiments: tuple[Experiment, ...],
    results: Results,
    folder: Path,
    recorded: str | None,
    people: PlayedTraining | None,
) -> str:
    """The section of the report; what stands beside the policies is measured once and kept in the folder.

    `people`: balls of human play that are seen by cameras.
    """
    configs = {one.name: one.config for one in experiments}
    if people is not None:
        configs[people.name] = people.config
        results[people.name] = [_as_result(one, people.config) for one in load_played(people, folder)]
    names = ", ".join(f"`{path.name}`" for path in ball_state_files(recorded)) if recorded else "people"
    low, high = CHOSEN_MPS
    most, seen = SPINNING_RADPS * math.sqrt(3), people.balls if people is not None else 0
    note = NOTE.format(low=low, high=high, spin=SPINNING_RADPS, most=most, flights=names, seen=seen)
    parts = [HEADING + "\n", textwrap.fill(f"Made by `{_command(recorded)}`. {note}", 118) + "\n"]
    for title, first in (
        (f"Serves of 5 m/s, spin up to {SPINNING_RADPS:g} rad/s about each axis", "spin"),
        (
            f"Serves of 5 m/s, spin within {SPINNING_RADPS:g} rad/s altogether ({WITHIN_RADPS:g} about each axis)",
            "within",
        ),
        ("Balls of human play", "human"),
    ):
        planned = [row for row in real_rows(recorded) if row.name.startswith(first)]
        rows = [row for row in planned if row is planned[0] or results[PREFIX + row.name]]
        if not rows:
            parts.append(f"{title}: not measured, for want of recorded balls (`--recorded PATH`).\n")
            continue
        table = [_policy_cells(row, configs[PREFIX + row.name], results) for row in rows]
        table += _beside(rows[0], configs[PREFIX + rows[0].name], folder)
        titles = (title, "training balls", "seeds", "returned, %", "error, mm", "median, mm", "aimed at", "reached")
        parts.append(markdown_table(titles, table))
        if missing := ", ".join(row.title for row in planned if not results[PREFIX + row.name]):
            parts.append(f"Not trained yet: {missing}.\n")
    return "\n".join([*parts, GOAL_NOTE])


def _as_result(played: PlayedSeed, config: RunConfig) -> SeedResult:
    score = played.score
    last = Evaluation(
        config.episodes, SPEED_MPS, score.return_rate, score.error_mm, score.error_returned_mm, score.missed
    )
    return SeedResult(played.seed, (last,), {}, math.nan, float(np.median(score.counted_mm)))


def _command(recorded: str | None) -> str:
    return "rallyscope bench learning --only real-balls" + (" --recorded PATH" if recorded else "")


def _run(environment: EnvironmentConfig, episodes: int, balls: int = 500) -> RunConfig:
    base = default_run("landing-model")
    curriculum = CurriculumConfig(speeds_mps=(SPEED_MPS,), episodes=(episodes,), replay="retain")
    return dataclasses.replace(
        base, environment=environment, curriculum=curriculum, landing_model=MODEL, evaluation_balls=balls
    )


def _policy_cells(row: RealRow, config: RunConfig, results: Results) -> list[object]:
    found = results[PREFIX + row.name]
    values = {what: values_at(found, config.episodes, what) for what in ("returned", "error_mm")}
    values["median_mm"] = [one.median_mm for one in found]
    aimed, verdicts = [], []
    for what, bound in (("returned", row.returned), ("error_mm", row.error_mm), ("median_mm", row.median_mm)):
        if bound is None:
            continue
        least = what == "returned"
        words = {"returned": f">= {100 * bound:g} %", "error_mm": f"<= {bound:g} mm"}
        aimed.append(words.get(what, f"median <= {bound:g} mm"))
        spread = spread_of(values[what])
        mean, end = (
            (spread.mean >= bound, spread.low >= bound) if least else (spread.mean <= bound, spread.high <= bound)
        )
        verdicts.append("-" if not spread.count else "yes" if end else "the mean alone" if mean else "**no**")
    cells = [shown(what, values[what]) for what in ("returned", "error_mm", "median_mm")]
    return [row.title, str(config.episodes), str(len(found)), *cells, ", ".join(aimed), ", ".join(verdicts)]


def _beside(row: RealRow, config: RunConfig, folder: Path) -> list[list[object]]:
    """What needs no training, on the balls of a row."""
    cells = [_beside_cells("built-in", config, folder), _beside_cells("limit", config, folder)]
    if row.name == "spin":
        table = dataclasses.replace(config, environment=dataclasses.replace(config.environment, racket="table"))
        cells.append(_beside_cells("limit", table, folder, ", the table's racket speed"))
    return cells


def _beside_cells(who: str, config: RunConfig, folder: Path, words: str = "") -> list[object]:
    score = _kept(folder, who, config)
    figures = [f"{100 * score['returned']:.1f}", f"{score['error_mm']:.1f}", f"{score['median_mm']:.1f}"]
    return [f"*{who}{words}*", "-", "-", *figures, "", ""]


def _kept(folder: Path, who: str, config: RunConfig) -> dict[str, float]:
    """Measured once: the file has the training's fingerprint in its name, as its balls depend on that alone."""
    path = folder / f"{PREFIX}{who}-{fingerprint(config)}.json"
    found = read_json(path)
    if not found:
        evaluator = PolicyEvaluator(config.environment, config.evaluation_balls)
        balls = evaluator.balls(SPEED_MPS)
        if who == "built-in":
            score = built_in_score(balls, config.environment)
        else:
            score = evaluator.score_actions(oracle_actions(balls, config.environment), SPEED_MPS)
        found = {
            "returned": score.return_rate,
            "error_mm": score.error_mm,
            "median_mm": float(np.median(score.counted_mm)),
        }
        write_json(path, found)
    return {name: float(str(value)) for name, value in found.items()}


def built_in_score(balls: ServeBatch, environment: EnvironmentConfig) -> PolicyScore:
    """The built-in controller on the same balls and targets, told each ball and its spin exactly."""
    controller, stroke = BuiltInController(environment.task), environment.task.stroke
    actions, speeds = np.zeros((len(balls), 3)), np.zeros(len(balls))
    limit = math.radians(stroke.action_limit_deg)
    solved = np.zeros(len(balls), np.bool_)
    for i, ball in enumerate(balls.arrivals.states):
        found = controller.solve(ball, balls.goals_m[i])
        if found is not None:
            actions[i] = 0.0, found.tilt_rad / limit, found.turn_rad / limit
            speeds[i], solved[i] = found.speed_mps, True
    outcomes = return_balls(balls.arrivals, strokes_from_actions(actions, speeds, stroke), environment.task)
    errors = np.where(solved, landing_errors_mm(outcomes, balls.goals_m), np.nan)
    return PolicyScore(balls.speed_mps, outcomes.returned & solved, errors)
