"""The paper's claims about learning, each with the numbers that speak for or against it here.

Claims are one family: of each, both sides have the same seeds, and the p-values are corrected for their number (Holm).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from benchmarks.learning.plan import EXPLORATIONS, RIVALS, rival_training
from benchmarks.learning.runs import Results, SeedResult
from core.errors import ConfigError
from core.learning.config import environment_profile
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.evaluation.trivial_policies import trusting_actions
from core.metrics.paired import (
    PairedComparison,
    holm,
    pair_by_seed,
    paired_difference,
    paired_ratio,
    seeds_as_text,
)
from core.text.markdown_table import markdown_table

Statistic = Literal["last", "five best"]
STATISTICS: Final[tuple[Statistic, ...]] = ("last", "five best")
LEVEL: Final = 0.05
MARGINS = (("4", "reward-4-cdta", 1000, 55.5), ("5", "replay-threshold", 1700, 35.8))
"""Speed, our training, episode, percent."""

_SLOW_3 = "reward-slow-3-cdta", "reward-slow-3-case"
_SLOW_4 = "reward-slow-4-cdta", "reward-slow-4-case"
_SIMPLE_3 = "reward-slow-3-simple"

NOTE = """
Every figure is of pairs: the seeds named, the same on both sides, with the same training balls wherever both train at
the same speeds. Return rates: mean difference, first minus second, with Student's 95 % interval. Errors: the ratio of
first to second, the geometric mean over the seeds with the 95 % interval of the t-test on the logarithms, and the mean
difference in mm. *Last*: the last policy; *five best*: the mean of the five lowest of a seed's evaluations every 50
episodes, which is the paper's figure (it is chosen on the balls that it is measured on). p is that of the claimed
ratio, or of no difference, two-sided; corrected by Holm over the whole family of a statistic. A claim *holds* if the
corrected p is below 0.05 and the estimate is on its side, is *contradicted* if it is on the other, and else it is *not
shown*. Intervals are not corrected.
"""


@dataclass(frozen=True, slots=True)
class Claim:
    """One training does better than another after so many episodes."""

    text: str
    better: str
    worse: str
    episode: int
    what: Literal["returned", "error_mm"]
    ratio: float = 1.0
    """Of errors: the first is at most so many times the second."""


def _margins() -> list[Claim]:
    """The paper's agent lands at least so many percent nearer than every rival: a claim per rival.

    TD3's default exploration is the matched one, and it is claimed of once.
    """
    found: dict[tuple[str, str], Claim] = {}
    for speed, ours, episode, percent in MARGINS:
        for exploration in EXPLORATIONS:
            for agent in RIVALS:
                text = f"at {speed} m/s >= {percent} % nearer than {agent.upper()}, {exploration} exploration"
                theirs = rival_training(speed, exploration, agent)
                found[ours, theirs] = Claim(text, ours, theirs, episode, "error_mm", 1 - percent / 100)
    return list(found.values())


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
    *_margins(),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found of one claim by one statistic."""

    claim: Claim
    seeds: tuple[int, ...]
    ratio: PairedComparison | None
    """Of errors."""
    difference: PairedComparison
    """In percentage points, or millimetres."""
    p: float
    """Corrected over the family; NaN without a test."""

    @property
    def verdict(self) -> str:
        """Whether the claim holds."""
        if math.isnan(self.p):
            return "-"
        if self.p >= LEVEL:
            return "not shown"
        if self.ratio is None:
            return "holds" if self.difference.estimate > 0 else "**contradicted**"
        return "holds" if self.ratio.estimate < self.claim.ratio else "**contradicted**"


def judge_claims(results: Results, claims: Sequence[Claim], statistic: Statistic) -> list[Finding | ConfigError | None]:
    """A finding per claim, corrected as one family; the refusal where the seeds differ, None where nothing was trained
    or the statistic is not one of the claim.
    """
    found = [_compare(results, claim, statistic) for claim in claims]
    raw = [_raw_p(one) if isinstance(one, Finding) else math.nan for one in found]
    corrected = holm(raw)
    return [
        Finding(one.claim, one.seeds, one.ratio, one.difference, p) if isinstance(one, Finding) else one
        for one, p in zip(found, corrected, strict=True)
    ]


def verdicts(results: Results) -> str:
    """A row per claim with both statistics side by side, and what they make of "nearer than every rival"."""
    found: dict[Statistic, list[Finding | ConfigError | None]] = {
        statistic: judge_claims(results, CLAIMS, statistic) for statistic in STATISTICS
    }
    rows = []
    for i, claim in enumerate(CLAIMS):
        cells, seeds = [], "-"
        for statistic in STATISTICS:
            one = found[statistic][i]
            if isinstance(one, ConfigError):
                cells += [str(one), "-"]
            elif one is None:
                cells += ["-", "-"]
            else:
                seeds = f"{len(one.seeds)} ({seeds_as_text(one.seeds)})"
                cells += [finding_as_text(one), one.verdict]
        rows.append([claim.text, seeds, *cells])
    titles = ("the paper's claim", "seeds", "last policy", "verdict", "five best", "verdict")
    families = ", ".join(f"{_size(found[s])} ({s})" for s in STATISTICS)
    lines = [_every_rival(speed, percent, found) for speed, _, _, percent in MARGINS]
    head = f"{NOTE}\nTests in the family: {families}.\n\n"
    return markdown_table(titles, rows) + head + "\n".join(lines) + "\n"


def _compare(results: Results, claim: Claim, statistic: Statistic) -> Finding | ConfigError | None:
    if claim.what == "returned" and statistic == "five best":
        return None
    sides = [_values(results[name], claim, statistic) for name in (claim.better, claim.worse)]
    if not any(sides):
        return None
    try:
        seeds, ours, theirs = pair_by_seed(*sides, where=f"{claim.better} against {claim.worse}")
    except ConfigError as error:
        return error
    is_error = claim.what == "error_mm"
    ratio = paired_ratio(ours, theirs, claim.ratio) if is_error else None
    return Finding(claim, seeds, ratio, paired_difference(ours, theirs), math.nan)


def _values(found: Sequence[SeedResult], claim: Claim, statistic: Statistic) -> Mapping[int, float]:
    """One number per seed, of those that got so far."""
    values: dict[int, float] = {}
    for result in found:
        evaluation = result.at(claim.episode)
        if evaluation is not None:
            value = getattr(evaluation, claim.what)
            value = 100 * value if claim.what == "returned" else value
            values[result.seed] = value if statistic == "last" else result.five_best_mm(evaluation.speed_mps)
    return values


def _raw_p(finding: Finding) -> float:
    return finding.difference.p if finding.ratio is None else finding.ratio.p


def _size(found: Sequence[Finding | ConfigError | None]) -> int:
    return sum(isinstance(one, Finding) and not math.isnan(one.p) for one in found)


def finding_as_text(finding: Finding) -> str:
    """Estimate with its interval, and p."""
    d, r = finding.difference, finding.ratio
    if d.count < 2:
        return f"{d.estimate:+.1f}, no interval of one seed"
    unit = "points" if r is None else "mm"
    words = f"{d.estimate:+.1f} [{d.low:+.1f}, {d.high:+.1f}] {unit}, p {p_as_text(finding.p)}"
    if r is None:
        return words
    asked = "" if finding.claim.ratio == 1 else f" (claimed <= {finding.claim.ratio:.3f})"
    return f"ratio {r.estimate:.2f} [{r.low:.2f}, {r.high:.2f}]{asked}, {words}"


def p_as_text(p: float) -> str:
    """Two digits, and no smaller than one thousandth."""
    return "-" if math.isnan(p) else "< 0.001" if p < 0.001 else f"{p:.2g}"


def _every_rival(speed: str, percent: float, found: Mapping[Statistic, list[Finding | ConfigError | None]]) -> str:
    """The paper says it of every rival: it holds if it holds of each."""
    said = []
    for statistic in STATISTICS:
        for exploration in EXPLORATIONS:
            names = {rival_training(speed, exploration, agent) for agent in RIVALS}
            mine = [one for one in found[statistic] if isinstance(one, Finding) and one.claim.worse in names]
            holding = sum(one.verdict == "holds" for one in mine)
            against = sum(one.verdict == "**contradicted**" for one in mine)
            said.append(f"{statistic}, {exploration}: holds for {holding} of {len(RIVALS)}, contradicted for {against}")
    return f"- At {speed} m/s at least {percent} % nearer than *every* rival: {'; '.join(said)}."


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
