"""Below the picture in Tune: the clusters of the window, and the scores."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.modes.tune.candidates import CandidatesTable
from app.modes.tune.score import ScorePanel
from app.panels.below_pictures import place_below_pictures


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None]) -> None:
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        place_below_pictures(gui, self.panel)
