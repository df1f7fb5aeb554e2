"""Residuals as a picture: where on each sensor they are and which way they point, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize

Array = NDArray[np.float64]

WIDTH: Final = 420
"""Width of a camera's panel, px."""
TOP, LEFT, GAP, BELOW, CHART = 52, 20, 40, 34, 130
ARROW: Final = 12.0
"""Drawn length of a median residual."""
MAX_ARROWS: Final = 600
"""More only hide each other."""
BINS: Final = 30
DOT, REJECTED, TEXT, GRID, BACK, PAPER = "#ff8c28", "#e03131", "#d7d9de", "#3a3d46", "#1a1b1e", "#101114"


@dataclass(frozen=True, slots=True, eq=False)
class ResidualPanel:
    """The residuals of one camera."""

    name: str
    sensor: SensorSize
    uvs_px: Array
    """(N, 2) where they are."""
    residuals_px: Array
    """(N, 2) found minus expected."""
    used: NDArray[np.bool_]
    """(N,) false for those that were left out."""


def residual_svg(title: str, panels: Sequence[ResidualPanel], beside: Sequence[str] = ()) -> str:
    """A column per camera: its picture with the residuals as strokes, magnified alike, and their histogram.

    `beside`: elements of further columns, each `WIDTH` wide from x = 0 and as high as the others.
    """
    heights = [WIDTH * panel.sensor.height_px / panel.sensor.width_px for panel in panels]
    width = LEFT + (len(panels) + len(beside)) * (WIDTH + GAP)
    height = TOP + max(heights, default=0) + BELOW + CHART + BELOW
    sizes = [np.linalg.norm(panel.residuals_px[panel.used], axis=1) for panel in panels]
    every = np.concatenate([*sizes, np.zeros(0)])
    median = float(np.median(every)) if len(every) else 1.0
    top = max(float(np.percentile(every, 99)) if len(every) else 1.0, 1e-3)
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height:.0f}' width='{width}'",
        f" font-family='sans-serif' font-size='11' fill='{TEXT}'>",
        f"<rect width='{width}' height='{height:.0f}' fill='{BACK}'/>",
        f"<text x='{LEFT}' y='18' font-size='13'>{escape(title)}</text>",
    ]
    for k, (panel, size) in enumerate(zip(panels, sizes, strict=True)):
        x0 = LEFT + k * (WIDTH + GAP)
        parts += _strokes(panel, x0, heights[k], ARROW / max(median, 1e-6), size)
        parts += _histogram(size, x0, TOP + max(heights) + BELOW, top)
    for k, column in enumerate(beside, len(panels)):
        parts.append(f"<g transform='translate({LEFT + k * (WIDTH + GAP)} 0)'>{column}</g>")
    return "".join([*parts, "</svg>"])


def _strokes(panel: ResidualPanel, x0: int, height: float, magnify: float, sizes: Array) -> list[str]:
    scale = WIDTH / panel.sensor.width_px
    rms = float(np.sqrt((sizes**2).mean())) if len(sizes) else float("nan")
    out = int((~panel.used).sum())
    caption = f"{panel.name}: {len(sizes)} points, {out} left out, rms {rms:.3f} px; drawn x {magnify / scale:.0f}"
    parts = [
        f"<text x='{x0}' y='{TOP - 8}'>{escape(caption)}</text>",
        f"<svg x='{x0}' y='{TOP}' width='{WIDTH}' height='{height:.1f}'>",
        f"<rect width='{WIDTH}' height='{height:.1f}' fill='{PAPER}' stroke='{GRID}'/>",
    ]
    chosen = np.linspace(0, len(panel.used) - 1, min(MAX_ARROWS, len(panel.used))).astype(int)
    for row in chosen:
        x, y = (panel.uvs_px[row] + 0.5) * scale
        if panel.used[row]:
            dx, dy = panel.residuals_px[row] * magnify
            parts.append(f"<path d='M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}' stroke='{DOT}' stroke-opacity='.7'/>")
            parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='1.2' fill='{DOT}'/>")
        else:
            parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='2' fill='none' stroke='{REJECTED}'/>")
    return [*parts, "</svg>"]


def _histogram(sizes: Array, x0: int, y0: float, top: float) -> list[str]:
    counts, _ = np.histogram(np.minimum(sizes, top), BINS, (0.0, top))
    tallest = max(int(counts.max()), 1)
    parts = [f"<path d='M{x0} {y0 + CHART:.1f}h{WIDTH}' stroke='{GRID}'/>"]
    for k, count in enumerate(counts.tolist()):
        tall = (CHART - 16) * count / tallest
        x, y = x0 + k * WIDTH / BINS, y0 + CHART - tall
        parts.append(f"<rect x='{x:.1f}' y='{y:.1f}' width='{WIDTH / BINS - 1:.1f}' height='{tall:.1f}' fill='{DOT}'/>")
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x, y = x0 + share * WIDTH, y0 + CHART + 14
        parts.append(f"<text x='{x:.1f}' y='{y:.1f}' text-anchor='middle'>{share * top:.2f}</text>")
    if len(sizes):
        median, p95 = np.percentile(sizes, (50, 95))
        parts.append(f"<text x='{x0 + WIDTH}' y='{y0 + 10:.1f}' text-anchor='end'>")
        parts.append(f"residual px: median {median:.3f}, p95 {p95:.3f}</text>")
    return parts
