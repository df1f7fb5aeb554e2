"""The paper's claims about learning, each with the numbers that speak for or against it here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.evaluation.learning_plan import EXPLORATIONS, RIVALS, Exploration, rival_training
from core.evaluation.learning_runs import SeedResult, values_at
from core.evaluation.learning_tables import paired
from core.learning.baselines import trusting_actions
from core.learning.config import environment_profile
from core.learning.scoring import Examiner
from core.learning.summary import spread_of

Results = Mapping[str, Sequence[SeedResult]]

MARGINS = (("4", "reward-4-cdta", 1000, 55.5), ("5", "replay-threshold", 1700, 35.8))
"""The paper's agent lands at least so many percent nearer than every rival: speed, our training, episode, percent."""

NOTE = """

Differences are first minus second, in brackets the 95 % interval. For the claim, those of return rates are positive,
those in millimetres negative, and the interval does not hold zero.
"""


def verdicts(results: Results) -> str:
    """A line per claim."""
    lines = []
    for title, cdta, case, episode in (
        ("3 m/s @350, the paper's pace", "reward-slow-3-cdta", "reward-slow-3-case", 350),
        ("3 m/s @350, our settings", "reward-3-cdta", "reward-3-case", 350),
        ("4 m/s @600, the paper's pace", "reward-slow-4-cdta", "reward-slow-4-case", 600),
    ):
        found = paired(results.get(cdta, ()), results.get(case, ()), episode, "returned")
        lines.append(f"- CDTA returns more balls than the case-based reward ({title}), percentage points: {found}.")
    found = paired(results.get("reward-4-cdta", ()), results.get("reward-4-case", ()), 1000, "error_mm")
    lines.append(f"- CDTA lands nearer than the case-based reward at 4 m/s @1000, mm: {found}.")
    for rule in ("discard", "retain"):
        a, b = results.get("replay-threshold", ()), results.get(f"replay-{rule}", ())
        found = paired(a, b, 1700, "error_mm")
        lines.append(f"- Keeping transitions by the threshold lands nearer than {rule} @1700, mm: {found}.")
    a, b = results.get("replay-threshold", ()), results.get("replay-scratch", ())
    lines.append(f"- The stage at 3 m/s helps against 1,700 episodes at 5 m/s, mm: {paired(a, b, 1700, 'error_mm')}.")
    for speed, ours, episode, percent in MARGINS:
        for exploration in EXPLORATIONS:
            lines.append(_margin(results, speed, exploration, ours, episode, percent))
    return "\n".join(lines) + NOTE


def _margin(results: Results, speed: str, exploration: Exploration, ours: str, episode: int, percent: float) -> str:
    own = spread_of(values_at(results.get(ours, ()), episode, "error_mm")).mean
    parts, reached = [], []
    for agent in RIVALS:
        theirs = spread_of(values_at(results.get(rival_training(speed, exploration, agent), ()), episode, "error_mm"))
        if theirs.count and own == own:
            nearer = 100 * (1 - own / theirs.mean)
            parts.append(f"{agent.upper()} {nearer:+.0f} %")
            reached.append(nearer >= percent)
    verdict = "-" if not reached else "holds" if all(reached) else f"holds for {sum(reached)} of {len(reached)}"
    claim = f"- At {speed} m/s the paper's agent lands at least {percent} % nearer than every rival"
    return f"{claim} ({exploration} exploration): {', '.join(parts)}: {verdict}."


def noise_floor(balls: int) -> str:
    """What noise on the state alone costs a player who knows the simulator perfectly."""
    environment = environment_profile(serves="hard", state_source="truth+noise")
    examiner = Examiner(environment, balls)
    found = []
    for speed in (5.0, 9.0):
        score = examiner.score_actions(trusting_actions(examiner.balls(speed), environment), speed)
        found.append(f"{score.error_mm:.0f} mm at {speed:g} m/s")
    return (
        "Noise of 5 mm and 1 % has a floor: the best angles for the perceived ball, found through the simulator, land "
        f"{' and '.join(found)} from the target (hard serves). A bound near it asks for perfect knowledge.\n"
    )
