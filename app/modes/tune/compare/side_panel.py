"""The panel at the left of the picture: how the methods compare over the recording, and where each fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, cast

import viser

from app.modes.tune.compare.charts import MethodCharts
from app.modes.tune.compare.report import comparison_html, stretch_names, stretches_html
from app.modes.tune.compare.run import CompareAnswer
from app.widgets import Choice, Listing
from core.detection.methods import Method
from core.metrics.compare import ErrorRun

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
        """What a comparison found."""
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
