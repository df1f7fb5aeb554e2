"""A small plot of how far a candidate's edge points are from its circle."""

from __future__ import annotations

from typing import Final

import numpy as np

from app import theme
from app.pictures.palette import palette
from app.views.stage_picture import KIND_INK
from core.detection.method_trace import Residuals

PLOT_PX: Final = (250, 70)
"""Width and height of the plot of residuals: with its title it is as high as the rows of the panel."""
PLOT_SPAN_PX: Final = 2.5
"""Residual at its upper edge: the width of the band of edge points."""
PLOTTED: Final = 400
"""Most points in it."""


def residuals_html(noun: str, label: int, residuals: Residuals) -> str:
    """A small plot of the edge points' distances from the circle over their direction, and the limit of their rms.

    It stays beside the rows while they scroll: below them it was out of sight in a window of 720 px.
    """
    width, height = PLOT_PX
    # Every dot is an element of the page: more slow the browser down and cover each other.
    every = max(1, len(residuals.angle_rad) // PLOTTED)
    x = (residuals.angle_rad[::every] / (2 * np.pi) + 0.5) * width
    y = (0.5 - np.clip(residuals.residual_px[::every] / PLOT_SPAN_PX, -1, 1) / 2) * height
    inks = {kind: palette("orange / blue")[ink].tolist() for kind, ink in KIND_INK.items()}
    dots = "".join(
        f"<circle cx='{px:.0f}' cy='{py:.1f}' r='1.3' fill='rgb{tuple(inks[kind])}'/>"
        for px, py, kind in zip(x.tolist(), y.tolist(), residuals.kind[::every].tolist(), strict=True)
    )
    limits = "".join(
        f"<line x1='0' x2='{width}' y1='{at:.1f}' y2='{at:.1f}' stroke='{theme.MUTED}' stroke-dasharray='{dash}'/>"
        for at, dash in (
            (height / 2, ""),
            ((0.5 - residuals.limit_px / PLOT_SPAN_PX / 2) * height, "3 3"),
            ((0.5 + residuals.limit_px / PLOT_SPAN_PX / 2) * height, "3 3"),
        )
    )
    legend = (
        "distance of the edge points from the circle, over their direction from its motion, -180° to 180°; "
        "green leading, blue trailing edge, red outliers; dashed: the limit of their rms"
    )
    return (
        f"<div style='flex:none;position:sticky;top:0;align-self:flex-start;width:{width}px' title='{legend}'>"
        f"<div style='color:{theme.MUTED};font-size:11px'>residuals of {noun} {label}, ±{PLOT_SPAN_PX:g} px, "
        f"-180° to 180°</div><svg width='{width}' height='{height}' role='img' "
        f"aria-label='residuals: {legend}' style='display:block;overflow:hidden'>{limits}{dots}</svg></div>"
    )
