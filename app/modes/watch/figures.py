"""HTML rows of names and figures, and the text of the learned constants."""

from __future__ import annotations

import math
from typing import Final

from app import theme
from app.formatting import GLOSSARY, html_text, percent, tooltip
from core.live.live_snapshot import Percentiles, PlayerHealth
from core.text import counted
from core.trajectory.learned_constants import LearnedConstants

STAGE_WORDS: Final = {
    "window": "From the end of a window until its block of 10 ms is here",
    "queue": "Until the chain takes it, the block's earlier windows among it",
    "decode": "Reading the events of the block",
    "detect": "The ball in the picture of each camera",
    "stereo": "Its place in space",
    "filter": "Its flight, and the prediction",
    "solve": "The stroke that sends it to the target",
    "send": "Until it is under way: the block's later windows, and the answer to the command before",
    "robot": "Until the robot or the simulation has answered",
}
"""What each stage of a command's way is, as a tooltip."""


def figures_html(rows: list[tuple[str, str]]) -> str:
    """HTML table with columns of a fixed width, so that changing figures do not move the lines."""
    name_style = f"color:{theme.MUTED};padding-right:10px;width:106px;vertical-align:top"
    cells = "".join(
        f"<tr><td style='{name_style}'{_title(name)}>{name}</td><td>{value}</td></tr>" for name, value in rows
    )
    table = f"<table style='table-layout:fixed;width:100%'>{cells}</table>"
    return f"<div style='font-size:12.5px;padding:2px 12px;line-height:1.45'>{table}</div>"


def percentiles_text(step: Percentiles) -> str:
    """Text of a duration's p50 and p99."""
    return f"{_ms(step.p50_ms)} ms (p50), {_ms(step.p99_ms)} ms (p99)"


def latency_rows(health: PlayerHealth) -> list[tuple[str, str]]:
    """Rows with where the time of commands goes, one a stage: median, p99 and worst; none before a command.

    Rows of the same table, not a table in it: beside the column of the names it would be wider than the panel.
    """
    if not health.stages:
        return []
    return [
        ("Where it goes [ms]", muted(_three("p50", "p99", "worst"))),
        *(
            (
                f"<span title='{html_text(STAGE_WORDS[one.name])}'>{one.name}</span>",
                _three(*map(_ms, (one.p50_ms, one.p99_ms, one.worst_ms))),
            )
            for one in health.stages
        ),
    ]


def _three(*cells: str) -> str:
    """Three narrow columns that stand below each other in several rows."""
    columns = "".join(
        f"<span style='display:inline-block;width:33.3%;text-align:right'>{cell}</span>" for cell in cells
    )
    return f"<span style='white-space:nowrap'>{columns}</span>"


def coloured(colour: str, html: str) -> str:
    """HTML in a colour of the theme."""
    return f"<span style='color:{colour}'>{html}</span>"


def muted(html: str) -> str:
    """HTML in the muted colour."""
    return coloured(theme.MUTED, html)


def _title(name: str) -> str:
    return f" title='{html_text(tooltip(name))}'" if name in GLOSSARY else ""


def _ms(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"


SURE: Final = 0.9


def learned_words(learned: LearnedConstants) -> str:
    """Drag, restitution and friction as text, each with its standard deviation."""
    if not learned.balls:
        return "published values; it learns from every ball"
    drag, restitution, friction = (
        f"{mean:.2f} ± {sigma:.2f}" for mean, sigma in zip(learned.means.tolist(), learned.sigmas.tolist(), strict=True)
    )
    if learned.air < 1 - SURE:
        air = "no air"
    elif learned.air > SURE:
        air = f"drag {drag}"
    else:
        air = f"air or none ({percent(learned.air)})"
    return f"{air}, restitution {restitution}, friction {friction} (learned from {counted(learned.balls, 'ball')})"
