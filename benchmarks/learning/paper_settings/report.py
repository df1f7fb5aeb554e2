"""The page on the settings: which lie within the paper's bounds, and what becomes of its claims there."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.learning.paper_settings.settings import (
    FIGURES,
    SCREEN_SEED,
    WORDS,
    Nearness,
    PaperFigure,
    Setting,
)
from benchmarks.learning.report import PAPER_BALLS
from benchmarks.learning.runs import Results
from benchmarks.learning.verdicts import Claim, Finding, finding_as_text, judge_claims
from core.learning.runs.summary import spread_of
from core.text.markdown_table import markdown_table

Ranked = Sequence[tuple[Setting, Nearness]]
SHOWN: Final = 12
"""Settings of the screen that the page lists."""
TITLE: Final = "# What would the paper's numbers take?\n"
NOTE: Final = """Made by `rallyscope bench paper-settings`. The paper does not say how its racket stands and moves,
how its targets are spread, how often its networks are updated; its physics may be richer than it says. {count}
settings of these were tried: physics `paper` or `real`; the face at action zero tilted by {pitches} degrees; the
racket's speed {rackets} times the table's; targets at one point, in our box (0.45 to 1.10 m, 0.45 m to both sides) or
on nearly the whole half; four updates an episode with our rates or two with both rates at 0.001. Each was trained with
one seed ({seed}): the paper's agent at 3 m/s, at 4 m/s, and 3 then 5 m/s with the threshold. A figure is *inside* if
it lies in Wilson's 95 % interval of the paper's rate (its rates are consistent with {balls} balls), or within a quarter
of its error, whose spread it does not say; errors are the five best evaluations, as the paper's. *Distance*: the mean
over the figures, where 1 is ten points or a quarter. The first {judged} were then judged, with seeds that chose
nothing.
"""
JUDGED_NOTE: Final = """Mean ± standard deviation over {seeds} seeds [between these a further seed lies in 95 of 100
cases, Student's t]. **Bold**: the paper's figure lies there, or its interval meets this one.
"""
CLAIMS_NOTE: Final = """Differences and ratios are of pairs of seeds, first against second, with their 95 % intervals; p
is corrected by Holm over all claims on return rates, and over all on errors. Errors are the five best evaluations.
"""


def write_paper_settings(path: Path, ranked: Ranked, best: Sequence[Setting], results: Results, seeds: int) -> None:
    """`ranked`: all settings of the screen, the nearest first; `results`: the trainings of the `best`."""
    levels = [sorted({getattr(setting, name) for setting, _ in ranked}) for name in ("pitch_deg", "racket")]
    pitches, rackets = (", ".join(f"{level:g}" for level in one) for one in levels)
    note = NOTE.format(
        count=len(ranked), pitches=pitches, rackets=rackets, seed=SCREEN_SEED, balls=PAPER_BALLS, judged=len(best)
    )
    parts = [
        TITLE,
        textwrap.fill(note, 118) + "\n",
        "## The nearest settings, one seed each\n",
        _screen_table(ranked),
        "## What each of them changes\n",
        "Mean over all settings that have it, one seed each.\n",
        _levels_table(ranked),
        "## Judged\n",
        textwrap.fill(JUDGED_NOTE.format(seeds=seeds), 118) + "\n",
        _judged_table(best, results),
        "## The paper's claims there\n",
        textwrap.fill(CLAIMS_NOTE, 118) + "\n",
        _claims_table(best, results),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(parts), encoding="utf-8")


def words_of(setting: Setting) -> str:
    """A setting in words, for a table."""
    updates = {"four": "4 updates", "two": "2 updates"}[setting.pace]
    tilt, speed = f"{setting.pitch_deg:+g} degrees", f"{setting.racket:g} x speed"
    return f"`{setting.physics}`, {tilt}, {speed}, {WORDS[setting.targets]}, {updates}"


def _screen_table(ranked: Ranked) -> str:
    rows = [
        [words_of(setting), f"{near.inside} of {len(FIGURES)}", f"{near.distance:.2f}", *_shown(near.values)]
        for setting, near in ranked[:SHOWN]
    ]
    paper = ["**the paper**", "", "", *_shown([figure.value for figure in FIGURES])]
    return markdown_table(("setting", "inside", "distance", *(figure.title for figure in FIGURES)), [paper, *rows])


def _levels_table(ranked: Ranked) -> str:
    sides: dict[str, Callable[[Setting], object]] = {
        "physics": lambda s: f"`{s.physics}`",
        "tilt": lambda s: f"{s.pitch_deg:+g} degrees",
        "racket": lambda s: f"{s.racket:g} x speed",
        "targets": lambda s: WORDS[s.targets],
        "pace": lambda s: f"{s.pace} updates",
    }
    rows = []
    for side, level_of in sides.items():
        for level in dict.fromkeys(level_of(setting) for setting, _ in ranked):
            values = [near.values for setting, near in ranked if level_of(setting) == level]
            inside = np.mean([near.inside for setting, near in ranked if level_of(setting) == level])
            rows.append([side, level, str(len(values)), f"{inside:.1f}", *_shown(np.mean(values, axis=0).tolist())])
    return markdown_table(("", "", "settings", "inside", *(figure.title for figure in FIGURES)), rows)


def _judged_table(best: Sequence[Setting], results: Results) -> str:
    rows = [[words_of(setting), *(_judged(setting, figure, results) for figure in FIGURES)] for setting in best]
    return markdown_table(("setting", *(figure.title for figure in FIGURES)), rows)


def _judged(setting: Setting, figure: PaperFigure, results: Results) -> str:
    scale = 100 if figure.is_rate else 1
    values = [figure.of_seed(result) for result in results[setting.training(figure.training)]]
    spread = spread_of(values)
    if spread.count < 2:
        return "-"
    reach = (spread.high - spread.mean) * math.sqrt(spread.count + 1)  # of one more seed, not of the mean
    low, high = max(0.0, spread.mean - reach), spread.mean + reach
    high = min(high, 1.0) if figure.is_rate else high
    least, most = figure.bounds if figure.is_rate else (figure.value, figure.value)
    text = f"{scale * spread.mean:.0f} ± {scale * spread.std:.0f} [{scale * low:.0f}, {scale * high:.0f}]"
    return f"**{text}**" if low <= most and least <= high else text


def _claims_table(best: Sequence[Setting], results: Results) -> str:
    claims = [claim for setting in best for claim in _claims_of(setting)]
    returned = [claim for claim in claims if claim.what == "returned"]
    errors = [claim for claim in claims if claim.what == "error_mm"]
    found = [*judge_claims(results, returned, "last"), *judge_claims(results, errors, "five best")]
    rows = [
        [claim.text, finding_as_text(one), one.verdict]
        if isinstance(one, Finding)
        else [claim.text, str(one or "-"), "-"]
        for claim, one in zip([*returned, *errors], found, strict=True)
    ]
    return markdown_table(("claim", "found", "verdict"), rows)


def _claims_of(setting: Setting) -> list[Claim]:
    where, name = words_of(setting), setting.training
    return [
        Claim(f"{where}: CDTA returns more than case, 3 m/s @350", name("3-cdta"), name("3-case"), 350, "returned"),
        Claim(f"{where}: CDTA returns more than case, 4 m/s @600", name("4-cdta"), name("4-case"), 600, "returned"),
        Claim(f"{where}: CDTA lands nearer than case, 4 m/s", name("4-cdta"), name("4-case"), 1000, "error_mm"),
        Claim(f"{where}: threshold lands nearer than discard", name("threshold"), name("discard"), 1700, "error_mm"),
    ]


def _shown(values: Sequence[float]) -> list[str]:
    return [
        f"{100 * value:.0f} %" if figure.is_rate else f"{value:.0f} mm"
        for figure, value in zip(FIGURES, values, strict=True)
    ]
