"""The panel at the left of the scene: curves, landings, the list of runs, the log."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser

from app.modes.train.charts_panel import ChartsPanel
from app.modes.train.kept_html import kept_html
from app.modes.train.maps.map_viewer import MapView
from app.modes.train.status import case_counts_html, log_html, map_html, offsets_title_html, runs_html
from app.modes.train.view import Details, RunsView
from app.panels.panel_layout import PanelLayout
from app.views.image_view import set_png

FIRST_PIXELS: Final = np.zeros((1, 1, 3), np.uint8)


class SidePanel:
    """What stands left of the scene in Train, for one browser."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = gui.add_panel(visible=False)
        with self._panel.add_tab("Curves"):
            self._charts = ChartsPanel(gui)
        with self._panel.add_tab("Landings"):
            self._plan = gui.add_image(FIRST_PIXELS, format="png")
            self._counts = gui.add_html("")
            gui.add_html(offsets_title_html())
            self._offsets = gui.add_image(FIRST_PIXELS, format="png")
        with self._panel.add_tab("Map"):
            self._map = gui.add_image(FIRST_PIXELS, format="png", visible=False)
            self._map_words = gui.add_html("")
        with self._panel.add_tab("Runs"):
            self._runs = gui.add_html("")
        with self._panel.add_tab("Log"):
            self._kept = gui.add_html("")
            self._log = gui.add_html("")
        self.room = PanelLayout(self._panel)

    def set_visible(self, visible: bool) -> None:
        """Show it or hide it."""
        self._panel.visible = visible

    def show_map(self, view: MapView) -> None:
        """Another policy's map."""
        self._map.visible = view.png is not None
        if view.png is not None:
            set_png(self._map, view.png)
        self._map_words.content = map_html(view.words)

    def show(self, view: RunsView, details: Details | None) -> None:
        """Follow the runs; what is drawn is drawn again only when the view brings something new."""
        self._runs.content = runs_html(view.runs, view.results)
        self._log.content = log_html(view.log, details)
        if view.run is None or view.details is None:
            return
        new = view.details
        several = view.run.config.seeds > 1
        self._charts.show(view.run.name, new.charts, view.compared, several_seeds=several, results=new.seed_results)
        set_png(self._plan, new.plan_png)
        set_png(self._offsets, new.offsets_png)
        self._kept.content = kept_html(new.stage_starts, view.run.config.curriculum)
        self._counts.content = case_counts_html(new.counts)
