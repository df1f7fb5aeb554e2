"""Controls of a comparison of methods, and its results: recall, error and step time over the recording, as charts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, cast

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from app import theme
from app.formatting import html_text
from app.modes.tune.compare_run import CompareAnswer, comparison_html, method_css, stretch_names, stretches_html
from app.state.client_state import ClientState
from app.state.commands import Command, CompareMethod, SetSideBySide
from app.widgets import Choice, Listing, curve_axis, decades, log_scale, when_changed, when_clicked
from core.detection.methods import METHODS, Method
from core.errors import CommandError
from core.metrics.compare import ErrorRun

Array = NDArray[np.float64]
HEIGHT_PX: Final = 94
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
                    axes=(curve_axis(22), curve_axis(38, decades(*STEP_RANGE_MS) if name == "step" else None)),
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
        return {"x": x, "y": log_scale(*STEP_RANGE_MS)}
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


def _title(text: str) -> str:
    return f"<div style='font-size:12px;padding:0 12px;margin-bottom:-4px;color:{theme.MUTED}'>{html_text(text)}</div>"


KNOWN: Final = "truth or labels"
SPANS: Final[dict[str, int | None]] = {
    "the whole recording": None,
    "2 s around the cursor": 2_000_000,
    "0.4 s around the cursor": 400_000,
}


class ComparePanel:
    """Controls of the method comparison in one browser; callbacks run in viser's event loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        send: Callable[[Command], None],
        start: Callable[[], None],
        cancel: Callable[[], None],
        show_result: Callable[[bool], None],
    ) -> None:
        self.folder = gui.add_folder("Compare methods", expand_by_default=False)
        self._ticks: dict[Method, viser.GuiCheckboxHandle] = {}
        with self.folder:
            for method, what in METHODS.items():
                self._ticks[method] = gui.add_checkbox(method, False, hint=what)
            self._side_by_side = gui.add_checkbox("Side by side", False, hint="Shows the same window with each method")
            self._against = gui.add_dropdown(
                "Reference",
                (KNOWN, *METHODS),
                hint="Truth of a simulated camera, else its labels; or a method to measure agreement with",
            )
            self._span = gui.add_dropdown("Over", tuple(SPANS))
            hint = "Recall, error and run time over the recording, and the places where each method fails"
            self._start = gui.add_button("Compare over time", icon=viser.Icon.CHART_LINE, color="teal", hint=hint)
            self._cancel = gui.add_button("Cancel the comparison", icon=viser.Icon.X, visible=False)
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._result = gui.add_checkbox("Show the result", True, visible=False, hint="The panel on the left")
        for method, tick in self._ticks.items():
            when_changed(tick, lambda value, method=method: send(CompareMethod(method, bool(value))))
        when_changed(self._side_by_side, lambda value: send(SetSideBySide(bool(value))))
        when_changed(self._result, lambda value: show_result(bool(value)))
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)

    @property
    def agree_with(self) -> Method | None:
        """Method that is taken as the reference; None for truth or labels.

        Raises:
            CommandError: for what the control does not offer.
        """
        against = str(self._against.value)
        if against != KNOWN and against not in METHODS:
            raise CommandError("no such choice", got=against[:20])
        return None if against == KNOWN else cast(Method, against)

    @property
    def span_us(self) -> int | None:
        """Length of the recording around the cursor; None for all of it.

        Raises:
            CommandError: for what the control does not offer.
        """
        span = str(self._span.value)
        if span not in SPANS:
            raise CommandError("no such choice", got=span[:20])
        return SPANS[span]

    def show(self, state: ClientState) -> None:
        """Update the controls from the state."""
        for method, tick in self._ticks.items():
            tick.value = method in state.tune.compared
        self._side_by_side.value = state.tune.side_by_side

    def show_running(self, running: bool) -> None:
        """Swap the start button for progress and cancel."""
        self._start.visible = not running
        self._cancel.visible = self._progress.visible = running
        self._progress.value = 0.0

    def show_progress(self, share: float) -> None:
        """Show the progress."""
        self._progress.value = 100.0 * share

    def show_result(self, there: bool) -> None:
        """Enable the result button; a new result is shown at once."""
        self._result.visible = self._result.value = there


WIDTH_PX: Final = 350
KINDS: Final = ("missed", "false")


class CompareSidePanel:
    """Results of the comparison in one browser. Called in the loop; `jump` runs in viser's event loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        later: Callable[[Callable[[], None]], None],
        jump: Callable[[Method, ErrorRun], None],
    ) -> None:
        """`later` calls something in the loop."""
        self._answer: CompareAnswer | None = None
        self._kind = KINDS[0]
        self._names: dict[str, ErrorRun] = {}
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Methods over time", viser.Icon.CHART_LINE):
            self._table = gui.add_html("")
            self._charts = MethodCharts(gui)
            with gui.add_folder("Look at"):
                self._method = Listing(gui, "Answers of", lambda name: later(self._show_stretches))
                self._choice = Choice(gui, "That are", KINDS, lambda kind: later(lambda: self._choose_kind(kind)))
                self._count = gui.add_html("")
                self._jump = gui.add_button_group("", ("-",), visible=False)
        self.panel.dock_left()
        self.panel.set_width(WIDTH_PX)
        self._choice.show(self._kind)

        @self._jump.on_click
        async def _(event: viser.GuiEvent) -> None:
            chosen = self._names.get(str(event.target.value))
            if event.client is not None and chosen is not None and self._method.chosen is not None:
                jump(cast(Method, self._method.chosen), chosen)

    def show(self, answer: CompareAnswer) -> None:
        """Show the result of a comparison."""
        self._answer = answer
        self._table.content = comparison_html(answer)
        self._charts.show(answer)
        self._method.offer(tuple(one.method for one in answer.methods))
        self._show_stretches()

    def _choose_kind(self, kind: str) -> None:
        if kind in KINDS:
            self._kind = kind
            self._choice.show(kind)
            self._show_stretches()

    def _show_stretches(self) -> None:
        answer, chosen = self._answer, self._method.chosen
        found = [one for one in answer.methods if one.method == chosen] if answer is not None else []
        if answer is None or not found:
            return
        missed = self._kind == KINDS[0]
        self._count.content = stretches_html(answer, found[0].method, missed=missed)
        self._names = stretch_names(found[0].missed if missed else found[0].false)
        self._jump.visible = bool(self._names)
        if self._names:
            self._jump.options = tuple(self._names)
