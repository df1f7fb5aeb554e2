"""Below the picture in Tune: the clusters of the window, and the scores."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.modes.tune.candidates import CandidatesTable
from app.modes.tune.score import ScorePanel
from app.modes.tune.settings import stage_counts_html
from app.panels.below_pictures import float_below_pictures, place_below_pictures


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None]) -> None:
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        with self.panel.add_tab("Auto-tune", viser.Icon.WAND):
            self._tuned = gui.add_html(stage_counts_html("nothing was tuned yet: open Auto-tune on the right"))
        place_below_pictures(gui, self.panel)
        self._taken_px = 0

    def make_room(self, width_px: int) -> None:
        """So much of the window's width is taken by something at the left."""
        if width_px != self._taken_px:
            self._taken_px = width_px
            float_below_pictures(self.panel, narrower_px=width_px)

    def show_tuned(self, content: str) -> None:
        """What a search for thresholds has found."""
        self._tuned.content = content
