"""A score as a picture: precision and recall over the tolerance, and the scatter of the centres about the labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from core.metrics import WindowAnswers
from labels.arrays import STATES, LabelArrays
from labels.model import LabelState

Array = NDArray[np.float64]
TOLERANCES: Final = np.linspace(0.0, 8.0, 81)
WIDTH, HEIGHT = 760, 250
FRAME = 200
"""Side of each of the two charts."""
TOP, LEFT, GAP = 26, 44, 110
REACH_PX = 4.0
"""Range of the scatter to each side; what is farther out is drawn on the rim."""
PRECISION, RECALL, DOT, TEXT, GRID = "#ff8c28", "#5096ff", "#6eeb82", "#d7d9de", "#3a3d46"


@dataclass(frozen=True, slots=True, eq=False)
class ScoreCurves:
    """The curves that the picture draws."""

    precision: Array
    """At each of TOLERANCES; nan without an answer."""
    recall: Array
    """At each of TOLERANCES; nan without a ball."""
    errors_px: Array
    """(N, 2) detector minus label, of the answers at visible balls."""


def measure_curves(answers: WindowAnswers, labels: LabelArrays) -> ScoreCurves:
    """The curves of answers (a row for each label) against labels; occluded balls count for nothing."""
    asked = labels.state != STATES.index(LabelState.OCCLUDED)
    seen, answered = labels.seen & asked, answers.detected & asked
    errors = np.column_stack([answers.u_px - labels.x_px, answers.v_px - labels.y_px])[seen & answered]
    distance = np.sort(np.hypot(errors[:, 0], errors[:, 1]))
    hits = np.searchsorted(distance, TOLERANCES, side="right").astype(np.float64)
    balls, given = int(seen.sum()), int(answered.sum())
    nothing = np.full(len(TOLERANCES), np.nan)
    return ScoreCurves(hits / given if given else nothing, hits / balls if balls else nothing, errors)


def score_svg(curves: ScoreCurves, title: str, *, noise_px: float | None = None) -> str:
    """The picture as SVG; `noise_px` is the annotator's own standard deviation, drawn as a circle."""
    second = LEFT + FRAME + GAP
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {HEIGHT}' width='{WIDTH}'",
        f" font-family='sans-serif' font-size='11' fill='{TEXT}'>",
        f"<rect width='{WIDTH}' height='{HEIGHT}' fill='#1a1b1e'/>",
        f"<text x='{LEFT}' y='16' font-size='12'>{escape(title)}</text>",
        *_frame(LEFT, [f"{value:g}" for value in (0, 2, 4, 6, 8)], ["1", ".75", ".5", ".25", "0"]),
        *_line(curves.precision, PRECISION),
        *_line(curves.recall, RECALL),
        f"<text x='{LEFT + FRAME + 8}' y='{TOP + 14}' fill='{PRECISION}'>precision</text>",
        f"<text x='{LEFT + FRAME + 8}' y='{TOP + 30}' fill='{RECALL}'>recall</text>",
        f"<text x='{LEFT + FRAME + 8}' y='{TOP + FRAME}'>tolerance [px]</text>",
        *_frame(second, [f"{value:+g}" for value in (-4, -2, 0, 2, 4)], ["-4", "-2", "0", "+2", "+4"]),
        *_scatter(curves.errors_px, second, noise_px),
        f"<text x='{second + FRAME + 8}' y='{TOP + 14}' fill='{DOT}'>detector - label [px]</text>",
    ]
    if beyond := int((np.abs(curves.errors_px) > REACH_PX).any(axis=1).sum()):
        text = f"{beyond} beyond {REACH_PX:g} px, on the rim"
        parts.append(f"<text x='{second + FRAME + 8}' y='{TOP + FRAME}'>{text}</text>")
    if noise_px is not None and np.isfinite(noise_px):
        text = f"the annotator's own noise: {noise_px:.2f} px"
        parts.append(f"<text x='{second + FRAME + 8}' y='{TOP + 30}'>{text}</text>")
    return "".join([*parts, "</svg>"])


def _frame(x0: int, across: list[str], down: list[str]) -> list[str]:
    parts = []
    for k, (below, beside) in enumerate(zip(across, down, strict=True)):
        x, y = x0 + FRAME * k / (len(across) - 1), TOP + FRAME * k / (len(down) - 1)
        parts.append(f"<path d='M{x:.1f} {TOP}V{TOP + FRAME}' stroke='{GRID}'/>")
        parts.append(f"<path d='M{x0} {y:.1f}H{x0 + FRAME}' stroke='{GRID}'/>")
        parts.append(f"<text x='{x:.1f}' y='{TOP + FRAME + 14}' text-anchor='middle'>{below}</text>")
        parts.append(f"<text x='{x0 - 6}' y='{y + 4:.1f}' text-anchor='end'>{beside}</text>")
    return parts


def _line(shares: Array, colour: str) -> list[str]:
    fine = np.isfinite(shares)
    if not fine.any():
        return []
    x = LEFT + FRAME * TOLERANCES[fine] / TOLERANCES[-1]
    y = TOP + FRAME * (1 - shares[fine])
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return [f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='2'/>"]


def _scatter(errors_px: Array, x0: int, noise_px: float | None) -> list[str]:
    middle_x, middle_y, scale = x0 + FRAME / 2, TOP + FRAME / 2, FRAME / (2 * REACH_PX)
    parts = []
    for dx, dy in np.clip(errors_px, -REACH_PX, REACH_PX).tolist():
        parts.append(
            f"<circle cx='{middle_x + dx * scale:.1f}' cy='{middle_y + dy * scale:.1f}' r='1.8' fill='{DOT}'"
            " fill-opacity='.6'/>"
        )
    if noise_px is not None and np.isfinite(noise_px):
        radius = noise_px * scale
        parts.append(f"<circle cx='{middle_x}' cy='{middle_y}' r='{radius:.1f}' fill='none' stroke='{TEXT}'/>")
    return parts
