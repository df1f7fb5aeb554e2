"""Charts of the reports, by matplotlib: SVG files without background and in grey ink, for pages light and dark.

Only pictures of events with circles are PNG, on white, for light pages that hold their pictures themselves.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from core.metrics.charts import chart_axes, chart_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ChartLine:
    """One method: mean and a band at each x."""

    name: str
    x: Sequence[float]
    mean: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]


Circle = tuple[float, float, float]
"""Centre and radius: u_px, v_px, r_px."""


@dataclass(frozen=True, slots=True, eq=False)
class CirclePanel:
    """Events about a ball, where it is, and where a method says that it is."""

    title: str
    on_px: Array
    """(N, 2) u and v of the events of pixels that became brighter."""
    off_px: Array
    """(M, 2) of those that became darker."""
    truth: Circle
    answer: Circle | None


def circle_panels(panels: Sequence[CirclePanel], *, half_px: float, dots_per_inch: int = 110) -> bytes:
    """Panels side by side as a PNG, each `half_px` to all sides of the true centre: ON orange, OFF blue, the truth a
    dashed black circle, the answer a green one with a cross.
    """
    with chart_figure((2.1 * len(panels), 2.5)) as figure:
        for number, panel in enumerate(panels):
            axes = figure.add_subplot(1, len(panels), number + 1)
            size = (72 * 1.9 / (2 * half_px)) ** 2  # a pixel of the sensor, in square points
            for places, colour in ((panel.on_px, "#f28e2b"), (panel.off_px, "#4e79a7")):
                axes.scatter(places[:, 0], places[:, 1], s=size, c=colour, marker="s", linewidths=0, alpha=0.8)
            _draw_circle(axes, panel.truth, "black", "--")
            if panel.answer is not None:
                _draw_circle(axes, panel.answer, "#1b9e3f", "-")
                axes.plot(*panel.answer[:2], marker="+", color="#1b9e3f", markersize=9, clip_on=True)
            u, v, _ = panel.truth
            axes.set(xlim=(u - half_px, u + half_px), ylim=(v + half_px, v - half_px), aspect="equal")
            axes.set(xticks=[], yticks=[])
            axes.set_title(panel.title, fontsize=9, color="black")
        written = io.BytesIO()
        figure.savefig(written, format="png", dpi=dots_per_inch, facecolor="white", metadata={"Software": None})
    return written.getvalue()


def _draw_circle(axes: Axes, circle: Circle, colour: str, style: str) -> None:
    angles = np.linspace(0, 2 * np.pi, 120)
    u, v, r = circle
    axes.plot(u + r * np.cos(angles), v + r * np.sin(angles), style, color=colour, linewidth=1.3)


def line_chart(
    path: Path, title: str, x_title: str, y_title: str, lines: Sequence[ChartLine], *, y_top: float | None = None
) -> None:
    """Write lines with their bands; what is above `y_top` is cut off at the frame."""
    with chart_axes(path, (7.2, 3.8), title, x_title, y_title) as axes:
        for number, line in enumerate(lines):
            axes.fill_between(line.x, line.low, line.high, color=f"C{number}", alpha=0.2, linewidth=0)
            axes.plot(line.x, line.mean, color=f"C{number}", label=line.name)
        axes.set(xlim=(0, None), ylim=(0, y_top))
        axes.grid(alpha=0.3)
        if lines:
            axes.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
