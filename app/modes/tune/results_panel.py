"""Below the picture in Tune: the candidates of the window, and the scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import viser

from app.formatting import html_text
from app.modes.tune.candidates import answer_html, answer_of_window_html, answers_html, verdict_html
from app.modes.tune.label_score import LabelScore, label_score_html
from app.modes.tune.run_score import RunScore, run_score_row, run_scores_html
from app.modes.tune.settings import stage_counts_html
from app.panels.keys import place_below_pictures
from app.widgets import bounded, when_changed, when_clicked
from core.detection.window import EarlyEnds
from core.metrics.run import WindowAnswer

KEPT = 6
"""Scores shown below each other, newest first, so that changes can be compared."""
MAX_DELAY_MS: Final = 1000.0
MAX_EVENTS: Final = 1_000_000
MAX_MOTION_PX: Final = 100.0


@dataclass(frozen=True, slots=True)
class Timing:
    """When answers come."""

    added_us: int
    """What an answer takes besides computing."""
    ends: EarlyEnds
    """What ends windows early."""


class ScorePanel:
    """Start, cancel, progress, and the last few scores."""

    def __init__(self, gui: viser.GuiApi, start: Callable[[], None], cancel: Callable[[], None]) -> None:
        self._gui = gui
        self._labels = gui.add_html("", visible=False)
        self._table = gui.add_html(stage_counts_html("No score yet"))
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._start = gui.add_button("Score this config on the whole recording", icon=viser.Icon.TARGET, color="teal")
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
        self._delay = gui.add_number(
            "Extra latency [ms]",
            0.0,
            min=0.0,
            max=MAX_DELAY_MS,
            step=0.5,
            hint="Time from cable, network and robot, added to the computing time in the Live columns",
        )
        self._events = gui.add_number(
            "Window ends [events]",
            0,
            min=0,
            max=MAX_EVENTS,
            step=100,
            hint="A window ends after so many events; 0: never. Counts for Score, Compare over time and Auto-tune",
        )
        self._motion = gui.add_number(
            "Window ends [px]",
            0.0,
            min=0.0,
            max=MAX_MOTION_PX,
            step=0.5,
            hint="A window ends when the ball has moved so far; 0: never. Counts for the same three",
        )
        self._runs: list[tuple[str, RunScore]] = []
        when_changed(self._delay, lambda _: self._show_runs())
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)

    @property
    def added_us(self) -> int:
        """What an answer takes besides computing."""
        return round(1e3 * bounded(self._delay.value, (0.0, MAX_DELAY_MS)))

    @property
    def timing(self) -> Timing:
        """What is chosen for scores, comparisons and searches."""
        events = round(bounded(self._events.value, (0.0, MAX_EVENTS)))
        motion_px = bounded(self._motion.value, (0.0, MAX_MOTION_PX))
        return Timing(self.added_us, EarlyEnds(events=events or None, motion_px=motion_px or None))

    def show_running(self, running: bool, title: str = "") -> None:
        """Swap the start button for progress and cancel; `title` names what is scored."""
        if not self._runs:
            self._table.content = stage_counts_html(html_text(f"Scoring {title}") if title else "No score yet")
        self._start.visible = not running
        self._cancel.visible = running
        self._progress.visible = running
        self._progress.value = 0.0

    def show_progress(self, share: float) -> None:
        """Show the share of the recording that is done."""
        self._progress.value = 100.0 * share

    def show_window(self, back: Callable[[], None]) -> None:
        """Show the last score against labels in its own window; `back`: go to where it was asked for."""
        modal = self._gui.add_modal("The detector against your labels")
        with modal:
            self._gui.add_html(f"<div data-rallyscope='wide' style='overflow-x:auto'>{self._labels.content}</div>")
            label = self._gui.add_button("Back to Label", icon=viser.Icon.ARROW_LEFT)
            stay = self._gui.add_button("Stay in Tune", icon=viser.Icon.CHECK)

        def go_back() -> None:
            modal.close()
            back()

        when_clicked(label, go_back)
        when_clicked(stay, modal.close)

    def show_score(self, title: str, score: RunScore | LabelScore) -> None:
        """Add a row; a score against labels has a table and a picture of its own."""
        if isinstance(score, LabelScore):
            self._labels.content = label_score_html(title, score)
            self._labels.visible = True
            self._table.visible = bool(self._runs)
            return
        self._table.visible = True
        self._runs = [(title, score), *self._runs][:KEPT]
        self._show_runs()

    def _show_runs(self) -> None:
        if self._runs:
            rows = [run_score_row(title, run, self.added_us) for title, run in self._runs]
            self._table.content = run_scores_html(rows)


RIMLESS_HINT: Final = "A glow, or one out of focus. Z undoes. Look at what is found: a face or a car may pass for it"


class CandidatesTable:
    """A table of the candidates of a window, the ball first; without a ball the reasons come before it."""

    def __init__(self, gui: viser.GuiApi, use_rimless: Callable[[], None]) -> None:
        self._nothing = gui.add_html("", visible=False)
        self._rimless = gui.add_button("Use the settings for a ball without a rim", visible=False, hint=RIMLESS_HINT)
        when_clicked(self._rimless, use_rimless)
        self._table = gui.add_html(stage_counts_html("Computing the first window ..."))

    def show(
        self,
        answers: tuple[tuple[str, WindowAnswer], ...],
        seconds: float,
        picked_px: tuple[float, float] | None = None,
        misses_px: tuple[float | None, ...] = (),
    ) -> None:
        """Show the candidates of each answer, under a title if there are several; a clicked one comes first.

        `misses_px` are their distances from the truth, see `miss_px`; empty if that is not shown.
        """
        distances_px = misses_px or (None,) * len(answers)
        if len(answers) > 1:
            shown = answers_html(answers, distances_px, picked_px)
        else:
            shown = "".join(answer_html(one, picked_px, px) for (_, one), px in zip(answers, distances_px, strict=True))
        self._show(f"{shown}{stage_counts_html(f'picture made in {seconds * 1e3:.0f} ms')}")

    def show_verdicts(self, answers: tuple[tuple[str, WindowAnswer], ...], seconds: float) -> None:
        """Show only what each of several methods answers."""
        lines = "".join(verdict_html(title, answer) for title, answer in answers)
        self._show(lines + stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms"))

    def _show(self, content: str) -> None:
        self._table.content = answer_of_window_html(content)

    def show_nothing_found(self, content: str, rimless: bool) -> None:
        """Show why nothing is found in the whole recording; nothing if empty. `rimless`: offer those settings."""
        self._nothing.content = answer_of_window_html(content)
        self._nothing.visible = bool(content)
        self._rimless.visible = rimless


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(
        self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None],
        use_rimless: Callable[[], None],
    ) -> None:  # fmt: skip
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui, use_rimless)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        with self.panel.add_tab("Auto-tune", viser.Icon.WAND):
            self._tuned = gui.add_html(stage_counts_html("No result yet. Start Auto-tune in the panel on the right"))
        place_below_pictures(gui, self.panel)

    def show_tuned(self, content: str) -> None:
        """Show the result of automatic tuning."""
        self._tuned.content = content
