"""The paper's claims on seeds drawn when the code was done: each *holds*, is *contradicted*, or is *not shown*.

`rallyscope bench learning --only claims` trains what is missing and writes the section of the report.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.learning.equal_trials import EQUAL_STEPS, OURS, SEEDS, TRIALS, TUNED_AGENTS, tuned, tuning_table
from benchmarks.learning.plan import RIVALS, Counts, Experiment, plan, rival_training
from benchmarks.learning.runs import (
    Column,
    Results,
    at,
    pair_by_seed,
    paired_difference,
    seeds_as_text,
    seeds_in_turn,
    shown,
    table_of_trainings,
    values_at,
)
from core.learning.config import RewardConfig, RunConfig
from core.learning.registered_agents import AgentName
from core.learning.runs.summary import spread_of
from core.text import markdown_table

DRAWN_FROM: Final = "c2645724"
"""The commit with which code and claims were done: nobody chooses its name, and nothing was tried on what it gives."""
FIRST_SEED: Final = 1_000_000 + int(DRAWN_FROM[:7], 16)
"""Above all seeds that were used before."""
PREFIX: Final = "claim-"
"""Of trainings here: results of their kind on other seeds have the name without it."""
SEEDS_AT_A_TIME: Final = 10
"""All trainings of a group get so many before the next group: what is interrupted has equal seeds within a group."""
LEVEL: Final = 0.05
HOME: Final = "closed form"
CHANGE: Final = 800
"""Episodes at 3 m/s, before the speed changes."""
END: Final = 1700
MARGIN: Final = 0.358
"""The paper, of its agent at 5 m/s: at least so much better than each rival."""
STORED_MM: Final = 1e-6
"""Errors are stored to so much, so that less than it is no difference."""
Verdict = Literal["holds", "contradicted", "not shown"]


@dataclass(frozen=True, slots=True)
class Claim:
    """That one training has a lower error, or a higher return rate, than another after so many episodes."""

    words: str
    ours: str
    theirs: str
    """Names of trainings, without the prefix that they have here."""
    what: Literal["error_mm", "returned"] = "error_mm"
    episode: int = END
    margin: float = 0.0
    """Share by which our error is to be lower."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What the seeds say of a claim."""

    claim: Claim
    seeds: int
    estimate: float
    """Mean ratio of the errors (geometric), ours by theirs, or difference of the return rates in points."""
    low: float
    """Lower end of its 95 % interval, without correction."""
    high: float
    p_value: float
    """Two-sided, corrected for all claims (Holm)."""
    verdict: Verdict


def _returns(other: str) -> list[Claim]:
    words = f"threshold returns more than {other}, {{}} balls after the change of speed"
    return [
        Claim(words.format(n), "replay-threshold", f"replay-{other}", "returned", CHANGE + n) for n in (50, 100)
    ]  # fmt: skip


def _rival(agent: AgentName) -> Claim:
    words = f"{100 * MARGIN:.1f} % nearer to the target than {agent.upper()}, both tuned"
    return Claim(words, f"tuned-{OURS}", f"tuned-{agent}", margin=MARGIN)


CLAIMS: Final = (
    Claim("threshold lands nearer to the target than retain", "replay-threshold", "replay-retain"),
    Claim("threshold lands nearer to the target than discard", "replay-threshold", "replay-discard"),
    *_returns("retain"),
    *_returns("discard"),
    Claim("3 m/s first lands nearer to the target than 5 m/s only", "replay-threshold", "replay-scratch"),
    Claim("the whole recipe lands nearer than 5 m/s only with the case reward", "replay-threshold", "straight-case"),
    *(_rival(agent) for agent in RIVALS),
    Claim("CDTA lands nearer to the target than case (4 m/s)", "reward-4-cdta", "reward-4-case", episode=1000),
)
"""The family that the correction is for."""
_GROUPS: Final = (
    (40, ("replay-threshold", "replay-discard", "replay-retain", "replay-scratch", "straight-case")),
    (20, tuple(f"tuned-{agent}" for agent in TUNED_AGENTS)),
    (40, ("reward-4-cdta", "reward-4-case")),
    (5, ("mujoco",)),
    (20, tuple(rival_training("5", "default", agent) for agent in RIVALS if agent != "td3")),
)
"""Trainings, the most wanted first, and how many seeds at most: 20 of those that take a minute or nearly so."""
_ROWS: Final = {
    "threshold (the paper's agent)": "replay-threshold",
    "discard": "replay-discard",
    "retain": "replay-retain",
    "5 m/s only": "replay-scratch",
    "5 m/s only, case reward": "straight-case",
    "threshold, tuned": f"tuned-{OURS}",
    **{
        f"{agent.upper()}, tuned, {'as many gradient steps' if agent in EQUAL_STEPS else 'own pace'}": f"tuned-{agent}"
        for agent in RIVALS
    },
    **{f"{agent.upper()}, default": rival_training("5", "default", agent) for agent in RIVALS if agent != "td3"},
    "threshold, trained and evaluated in MuJoCo": "mujoco",
}
_REWARDS: Final = {"CDTA at 4 m/s": "reward-4-cdta", "case at 4 m/s": "reward-4-case"}


def claim_experiments(counts: Counts) -> tuple[Experiment, ...]:
    """Every training that a claim is about, and the rivals' defaults, which none is; the most wanted first."""
    planned = {one.name: one.config for one in plan(counts)}
    paper = planned["replay-threshold"]
    own: dict[str, RunConfig] = {
        "straight-case": replace(planned["replay-scratch"], reward=RewardConfig(kind="case")),
        # Evaluated at the end alone: 500 balls take longer there than all that is learned from.
        "mujoco": replace(
            paper, environment=replace(paper.environment, engine="mujoco"), checkpoint_every=paper.episodes
        ),
        **{f"tuned-{agent}": config for agent, config in tuned(counts).items()},
    }
    found = []
    for most, names in _GROUPS:
        for name in names:
            seeds = min(counts.claim_seeds, most)
            config = replace((planned | own)[name], seeds=seeds, first_seed=FIRST_SEED)
            home = ((HOME, paper.environment),) if name == "mujoco" else ()
            found.append(Experiment(PREFIX + name, config, home))
    return tuple(found)


def claim_batches(experiments: Sequence[Experiment]) -> list[list[tuple[Experiment, int]]]:
    """All their seeds: ten of every training of a group, seed by seed, then of the next group, then the next ten."""
    found: dict[tuple[int, int], list[tuple[Experiment, int]]] = {}
    groups = {PREFIX + name: number for number, (_, names) in enumerate(_GROUPS) for name in names}
    for one, seed in seeds_in_turn(experiments):
        turn = (seed - one.config.first_seed) // SEEDS_AT_A_TIME
        found.setdefault((turn, groups[one.name]), []).append((one, seed))
    return [found[key] for key in sorted(found)]


def findings(results: Results) -> list[Finding]:
    """What the seeds that both sides have say of every claim; a claim with fewer than two of them counts as a test."""
    tested = [_tested(claim, results) for claim in CLAIMS]
    corrected = holm([p_value for _, _, p_value in tested])
    found = []
    for claim, (count, values, _), p_value in zip(CLAIMS, tested, corrected, strict=True):
        spread = paired_difference(values, np.zeros_like(values))
        ends = [100 * x if claim.what == "returned" else float(np.exp(x)) * (1 - claim.margin)
                 for x in (spread.estimate, spread.low, spread.high)]  # fmt: skip
        better = spread.estimate > 0 if claim.what == "returned" else spread.estimate < 0
        verdict: Verdict = "not shown" if not p_value < LEVEL else "holds" if better else "contradicted"
        found.append(Finding(claim, count, ends[0], ends[1], ends[2], p_value, verdict))
    return found


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for the number of tests, Holm's way, in the same order."""
    corrected, largest = [1.0] * len(p_values), 0.0
    for place, number in enumerate(np.argsort(p_values, kind="stable").tolist()):
        largest = max(largest, min(1.0, (len(p_values) - place) * p_values[number]))
        corrected[number] = largest
    return corrected


def _tested(claim: Claim, results: Results) -> tuple[int, NDArray[np.float64], float]:
    """Seeds, the paired values (N,), and their two-sided p-value; negative logarithms are what is claimed of errors."""
    sides = [{one.seed: getattr(e, claim.what) for one in results[PREFIX + name] if (e := one.at(claim.episode))}
             for name in (claim.ours, claim.theirs)]  # fmt: skip
    both = sides[0].keys() & sides[1].keys()
    paired = [{seed: side[seed] for seed in both} for side in sides]
    _, ours, theirs = pair_by_seed(*paired, where=claim.words)
    values = ours - theirs if claim.what == "returned" else np.log(ours / theirs) - np.log1p(-claim.margin)
    if len(values) < 2 or np.ptp(values) == 0:  # no scatter: no test
        return len(values), values, 1.0
    test: Any = stats.ttest_1samp(values, 0.0)  # scipy has no types for it
    return len(values), values, float(test.pvalue)


TEXT: Final = """Made by `rallyscope bench learning --only claims`, which goes on where it was interrupted. Seeds are
drawn: the first is 1,000,000 plus the first seven hexadecimal digits, as a number, of commit {commit}, with which code
and claims were done; the others follow it. No setting was chosen on them, and every seed that ended is here. Before all
that are wanted are there, verdicts are preliminary; how many there are was decided by time, not by results. {seeds}
Both sides have the same seeds and the same balls. *Ratio*: geometric mean of our error by the other's, under 1 is
better; *points*: difference of the return rates; [95 % interval of the mean, Student's t, uncorrected]. p: two-sided
paired t test, of errors on their logarithms, against a ratio of {ratio:.3f} where {margin:.1f} % are claimed; corrected
for all {claims} claims (Holm). *holds*, *contradicted*: p < {level}, in the claimed direction or the other. Claims
without two pairs are *not shown*.

*Tuned*: the paper's agent and every rival had {trials} trials each: the first as they were before, the others the same
draws of learning rate, first noise and width for all, and for PPO and TRPO of the balls between updates. The best has
the lowest geometric mean of the error on {tuning_seeds} other seeds (`python -m benchmarks.learning.equal_trials`).
Before, the settings of the paper's agent had been chosen by development, so it had more trials than the rivals. *As
many gradient steps*: {updates} after each ball, as the paper's agent has, after the same 32 balls. PPO makes as many
passes over its balls; A2C and TRPO take one step from each set of balls, which is what they are. All rivals: the case
reward, true states, 1,700 balls straight at 5 m/s. *Default*: as the library comes, for orientation; TD3's default is
that with noise of 0.1 and one step."""


def claims_section(experiments: Sequence[Experiment], results: Results) -> str:
    """The section of the report: every claim with its verdict, and the figures of every training."""
    ours = experiments[0].config
    rows = [[f.claim.words, f.seeds, _interval(f), f"{f.p_value:.2g}", f.verdict] for f in findings(results)]
    text = TEXT.format(
        commit=DRAWN_FROM,
        seeds=_seeds(experiments, results),
        ratio=1 - MARGIN,
        margin=100 * MARGIN,
        claims=len(CLAIMS),
        level=LEVEL,
        updates=ours.ddpg.updates_per_episode,
        trials=TRIALS,
        tuning_seeds=SEEDS,
    )
    columns: dict[str, Column] = {
        "returned @850, %": at(CHANGE + 50, "returned"),
        "@900, %": at(CHANGE + 100, "returned"),
        "@1700, %": at(END, "returned"),
        "error @1700, mm": at(END, "error_mm"),
        "worst seed": lambda found: f"{max(values_at(found, END, 'error_mm'), default=math.nan):.0f}",
        "processor time, s": lambda found: f"{spread_of([one.cpu_s for one in found]).mean:.0f}",
    }
    present = {words: PREFIX + name for words, name in _ROWS.items() if results[PREFIX + name]}
    parts = [
        "## The paper's claims\n",
        *(textwrap.fill(" ".join(part.split()), 118) + "\n" for part in text.split("\n\n")),
        markdown_table(("claim", "seeds", "ratio or points", "p", "verdict"), rows, ("", "d")),
        "What was trained, 1,700 balls (@850 and @900: 50 and 100 balls after the change of speed):\n",
        table_of_trainings(results, "", present, columns),
        "The tuning, errors on the seeds that were tuned on:\n",
        tuning_table(),
        *_mujoco(results),
    ]
    return "\n".join(parts)


def _seeds(experiments: Sequence[Experiment], results: Results) -> str:
    """Which seeds of each group there are, and how many are missing of those wanted."""
    wanted = {one.name: one.config.seeds for one in experiments}
    there: dict[str, list[str]] = {}
    for words, name in (_ROWS | _REWARDS).items():
        had, most = [one.seed for one in results[PREFIX + name]], wanted.get(PREFIX + name, 0)
        few = "" if len(had) == most else f" ({len(had)} of {most} that are wanted)"
        there.setdefault(seeds_as_text(had) + few, []).append(words)
    return "Seeds so far: " + "; ".join(f"{seeds}: {' / '.join(names)}" for seeds, names in there.items()) + "."


def _interval(found: Finding) -> str:
    """The estimate and its interval as text."""
    if found.seeds < 2:
        return "-"
    if found.claim.what == "returned":
        return f"{found.estimate:+.1f} points [{found.low:+.1f}, {found.high:+.1f}]"
    return f"{found.estimate:.2f} [{found.low:.2f}, {found.high:.2f}]"


def _mujoco(results: Results) -> list[str]:
    """How far policies that were trained in MuJoCo land from the target in closed form, and how far apart both are."""
    there = {one.seed: one for one in results[f"{PREFIX}mujoco"]}
    if not there:
        return []
    carried = shown("error_mm", [one.transfers[HOME].error_mm for one in there.values()])
    home = {one.seed: last.error_mm for one in results[f"{PREFIX}replay-threshold"] if (last := one.at(END))}
    apart = [abs(last.error_mm - home[seed]) for seed, one in there.items() if (last := one.at(END)) and seed in home]
    text = f"Policies that were trained in MuJoCo land {carried} mm from the target in closed form. "
    if apart:
        farthest = f"up to {max(apart):.2g}" if max(apart) >= STORED_MM else f"less than {STORED_MM:g}"
        text += f"A seed that is trained in both ends {farthest} mm apart ({len(apart)} seeds)."
    return [textwrap.fill(text, 118) + "\n"]
