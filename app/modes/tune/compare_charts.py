"""Recall, error and step time of the compared methods over the recording, as charts of one browser."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from app import theme
from app.formatting import html_text
from app.modes.tune.compare_run import CompareAnswer, method_css
from core.detection.methods import METHODS

Array = NDArray[np.float64]
HEIGHT_PX: Final = 94
AXIS: Final = "#9aa0aa"
GRID: Final = "#32363e"
STEP_RANGE_MS: Final = (0.01, 30.0)
"""Ends of the logarithmic scale, ms: from `auto` in a region to EBPP on the whole sensor."""
WIDEST_PX: Final = 5
"""Width of the first curve. Later curves are thinner, so that equal curves all stay visible."""
ERROR_TOPS_PX: Final = (1.0, 2.0, 4.0, 8.0)
"""The error's scale ends at one of these; the last is the match radius."""


class MethodCharts:
    """Charts of one browser, made with the first comparison: an empty chart may never show its ticks. Later only data
    is sent.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._place = gui.add_folder(None, visible=False)
        self._titles: dict[str, viser.GuiHtmlHandle] = {}
        self._charts: dict[str, viser.GuiUplotHandle] = {}

    def show(self, answer: CompareAnswer) -> None:
        """Draw a comparison; it replaces the last one."""
        titles, columns = chart_titles(answer), method_columns(answer)
        for name, title in titles.items():
            scales = _scales(name, answer.axis_s, columns[name])
            if name in self._charts:
                self._titles[name].content = _title(title)
                self._charts[name].data = (answer.axis_s, *columns[name])
                self._charts[name].scales = scales
                continue
            with self._place:
                self._titles[name] = self._gui.add_html(_title(title))
                self._charts[name] = self._gui.add_uplot(
                    (answer.axis_s, *columns[name]),
                    _series(),
                    scales=scales,
                    axes=(_axis(22), _axis(38, grid=name != "step")),
                    legend=uplot.Legend(show=False),
                    height=HEIGHT_PX,
                    padding=(6, 14, 0, 2),
                )
        self._place.visible = True


def chart_titles(answer: CompareAnswer) -> dict[str, str]:
    """Name of a chart -> what it shows."""
    agreement = answer.kind == "method"
    return {
        "recall": f"Balls of {answer.reference} that are also found, %" if agreement else "Recall, %",
        "error": f"Distance from {answer.reference}, px, median" if agreement else "Error, px, median",
        "step": "Step, ms of processor time, median",
    }


def method_columns(answer: CompareAnswer) -> dict[str, list[Array]]:
    """Name of a chart -> a curve (B,) for each of METHODS, nan where it is not compared."""
    curves = {one.method: one.curves for one in answer.methods}
    nothing = np.full(len(answer.axis_s), np.nan)
    columns: dict[str, list[Array]] = {"recall": [], "error": [], "step": []}
    for method in METHODS:
        own = curves.get(method)
        columns["recall"].append(100.0 * own.recall if own else nothing)
        columns["error"].append(own.error_px if own else nothing)
        columns["step"].append(np.clip(1e3 * own.step_s, *STEP_RANGE_MS) if own else nothing)
    return columns


def _scales(name: str, axis_s: Array, curves: list[Array]) -> dict[str, uplot.Scale]:
    half = (axis_s[1] - axis_s[0]) / 2 if len(axis_s) > 1 else 0.005
    x = uplot.Scale(time=False, auto=False, range=(float(axis_s[0] - half), float(axis_s[-1] + half)))
    if name == "recall":
        return {"x": x, "y": uplot.Scale(auto=False, range=(0.0, 104.0))}
    if name == "step":
        return {"x": x, "y": uplot.Scale(auto=False, range=STEP_RANGE_MS, distr=3, log=10)}
    known = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
    highest = float(known.max()) if len(known) else 0.0
    top = next((top for top in ERROR_TOPS_PX if highest <= top), ERROR_TOPS_PX[-1])
    return {"x": x, "y": uplot.Scale(auto=False, range=(0.0, top))}


def _series() -> tuple[uplot.Series, ...]:
    lines = (
        uplot.Series(
            label=method,
            stroke=method_css(method),
            width=max(1, WIDEST_PX - number),
            points={"show": True, "size": 3},
        )
        for number, method in enumerate(METHODS)
    )
    return (uplot.Series(label="s"), *lines)


def _axis(size: int, *, grid: bool = True) -> uplot.Axis:
    """Options of an axis; a logarithmic one has no grid, which would have too many lines."""
    return uplot.Axis(
        stroke=AXIS,
        size=size,
        font="11px sans-serif",
        grid={"show": grid, "stroke": GRID, "width": 1},
        ticks={"show": grid, "stroke": GRID, "width": 1, "size": 4},
    )


def _title(text: str) -> str:
    return f"<div style='font-size:12px;padding:0 12px;margin-bottom:-4px;color:{theme.MUTED}'>{html_text(text)}</div>"
