"""The paper's claims about learning, each with the numbers that speak for or against it here."""

from __future__ import annotations

from dataclasses import dataclass

from core.bench.learning.plan import EXPLORATIONS, RIVALS, Exploration, rival_training
from core.bench.learning.runs import Results, values_at
from core.bench.learning.tables import difference, paired_spread
from core.learning.config import environment_profile
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.evaluation.trivial_policies import trusting_actions
from core.learning.runs.summary import SeedSpread, spread_of
from core.text.markdown_table import markdown_table

MARGINS = (("4", "reward-4-cdta", 1000, 55.5), ("5", "replay-threshold", 1700, 35.8))
"""The paper's agent lands at least so many percent nearer than every rival: speed, our training, episode, percent."""

_SLOW_3 = "reward-slow-3-cdta", "reward-slow-3-case"
_SLOW_4 = "reward-slow-4-cdta", "reward-slow-4-case"
_SIMPLE_3 = "reward-slow-3-simple"

NOTE = """
Differences are first minus second, in brackets the 95 % interval over paired seeds. A claim *holds* if the whole
interval is on its side of zero, is *contradicted* if it is on the other, and *not shown* if zero is inside.
"""


@dataclass(frozen=True, slots=True)
class Claim:
    """One training does better than another after so many episodes."""

    text: str
    better: str
    worse: str
    episode: int
    what: str


CLAIMS = (
    Claim("CDTA returns more than case-based, 3 m/s @350, the paper's pace", *_SLOW_3, 350, "returned"),
    Claim("the same with our settings", "reward-3-cdta", "reward-3-case", 350, "returned"),
    Claim("CDTA returns more than case-based, 4 m/s @600, the paper's pace", *_SLOW_4, 600, "returned"),
    Claim("the same with our settings", "reward-4-cdta", "reward-4-case", 600, "returned"),
    Claim("CDTA returns more than simple, 3 m/s @350, the paper's pace", _SLOW_3[0], _SIMPLE_3, 350, "returned"),
    Claim("CDTA lands nearer than case-based, 4 m/s @1000, the paper's pace", *_SLOW_4, 1000, "error_mm"),
    Claim("the same with our settings", "reward-4-cdta", "reward-4-case", 1000, "error_mm"),
    Claim("threshold lands nearer than discard @1700", "replay-threshold", "replay-discard", 1700, "error_mm"),
    Claim("threshold lands nearer than retain @1700", "replay-threshold", "replay-retain", 1700, "error_mm"),
    Claim("3 m/s first lands nearer than 5 m/s only @1700", "replay-threshold", "replay-scratch", 1700, "error_mm"),
)


def verdicts(results: Results) -> str:
    """A row per claim, and the margins over the rivals."""
    rows = []
    for claim in CLAIMS:
        spread = paired_spread(results[claim.better], results[claim.worse], claim.episode, claim.what)
        unit = "points" if claim.what == "returned" else "mm"
        shown = f"{difference(spread)} {unit}" if spread.count > 1 else "-"
        rows.append([claim.text, shown, str(spread.count), judge(spread, more_is_better=claim.what == "returned")])
    lines = [
        _margin(results, speed, exploration, ours, episode, percent)
        for speed, ours, episode, percent in MARGINS
        for exploration in EXPLORATIONS
    ]
    return (
        markdown_table(("the paper's claim", "here", "seeds", "verdict"), rows) + NOTE + "\n" + "\n".join(lines) + "\n"
    )


def judge(spread: SeedSpread, *, more_is_better: bool) -> str:
    """What an interval of differences says about a claim."""
    if spread.count < 2:
        return "-"
    low, high = (spread.low, spread.high) if more_is_better else (-spread.high, -spread.low)
    return "holds" if low > 0 else "**contradicted**" if high < 0 else "not shown"


def _margin(results: Results, speed: str, exploration: Exploration, ours: str, episode: int, percent: float) -> str:
    own = spread_of(values_at(results[ours], episode, "error_mm")).mean
    parts, reached = [], []
    for agent in RIVALS:
        theirs = spread_of(values_at(results[rival_training(speed, exploration, agent)], episode, "error_mm"))
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
    evaluator = PolicyEvaluator(environment, balls)
    found = []
    for speed in (5.0, 9.0):
        score = evaluator.score_actions(trusting_actions(evaluator.balls(speed), environment), speed)
        found.append(f"{score.error_mm:.0f} mm at {speed:g} m/s")
    return (
        "Noise of 5 mm and 1 % has a floor: the best angles for the perceived ball, found through the simulator, land "
        f"{' and '.join(found)} from the target (hard serves). A bound near it asks for perfect knowledge.\n"
    )
