"""Find a ball again: the index of all recordings, data sets and runs, its conditions, and a page of the list."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app import theme
from app.background.jobs import LatestWins, LoopJob, Progress
from app.formatting import html_text, note_html
from app.modes.mode import ModeHost
from app.modes.watch.ball_list import ROWS, BallQuery, balls_html, count_html, moment_link, select_balls
from app.shared.ball_index import BallIndex, BallSource, ball_sources, index_balls
from app.state.client_state import ModeName
from app.widgets import Choice, when_changed, when_clicked
from core.errors import CommandError, ConfigError

OPENS_IN: Final[tuple[ModeName, ...]] = ("Watch", "Tune", "Label")
LOOK_EVERY_S: Final = 5.0
"""Interval at which new recordings and runs are looked for, once somebody has asked for the balls."""


class BallsPanel:
    """The list of one browser. Methods are called by its loop; indexing and selecting are done off it."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._index: BallIndex | None = None
        self._selected: NDArray[np.int64] = np.zeros(0, np.int64)
        self._first = 0
        self._mode: ModeName = OPENS_IN[0]
        self._known: object = None
        self._looked_s = 0.0
        self._job: LoopJob[BallIndex] = LoopJob(host.later, host.report, self._show_running)
        self._selection = LatestWins(host.pool, select_balls, self._found, self._failed)
        with gui.add_folder("Balls", expand_by_default=False):
            hint = "Every flight, bounce and stroke of all recordings, data sets and runs of this workspace"
            self._find = gui.add_button("Find balls", icon=viser.Icon.SEARCH, hint=hint)
            self._stop = gui.add_button("Stop", icon=viser.Icon.X, visible=False)
            self._progress = gui.add_progress_bar(0.0, visible=False)
            hint = "Such as: kind=stroke outcome=net|out speed_mps=5..7 spin_radps=50.. name=demo"
            self._conditions = gui.add_text("Conditions", "", hint=hint, visible=False)
            self._opens = Choice(gui, "Open in", OPENS_IN, self._choose_mode, hint="Where a click shows the moment")
            self._opens.visible = False
            self._count = gui.add_html("", visible=False)
            self._table = gui.add_html("", visible=False)
            self._pages = gui.add_button_group("Page", ("Previous", "Next"), visible=False)
            hint = "Runs the tracker over each of them, which takes about as long as they last, or longer"
            self._track = gui.add_button("Track the unknown recordings", visible=False, hint=hint)
        when_clicked(self._find, lambda: host.later(self._start))
        when_clicked(self._track, lambda: host.later(lambda: self._start(track=True)))
        when_clicked(self._stop, lambda: host.later(self._job.cancel))
        when_changed(self._conditions, lambda _: host.later(self._select))

        @self._pages.on_click
        async def _(event: viser.GuiEvent) -> None:
            step = ROWS if event.target.value == "Next" else -ROWS
            host.later(lambda: self._turn(step))

    def tick(self, wall_s: float) -> None:
        """Show the progress, and index anew when recordings or runs have come or gone."""
        if self._job.share is not None and abs(self._progress.value - 100 * self._job.share) >= 1:
            self._progress.value = 100 * self._job.share
        if self._index is None or self._job.running or wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        if _paths(self._sources()) != self._known:
            self._start()

    def close(self) -> None:
        """The browser has disconnected."""
        self._job.close()
        self._selection.close()

    def _sources(self) -> tuple[BallSource, ...]:
        return ball_sources(self._host.services.workspace.root, self._host.services.library.folders)

    def _start(self, *, track: bool = False) -> None:
        sources, root = self._sources(), self._host.services.workspace.root
        if not sources:
            raise CommandError("no recordings and no runs yet", remedy="record, simulate or open one")
        self._known = _paths(sources)

        def work(progress: Progress, cancelled: Callable[[], bool]) -> BallIndex:
            return index_balls(sources, root, track=track, progress=progress, cancelled=cancelled)

        self._job.start(work, self._use)
        self._show_running()

    def _show_running(self) -> None:
        running = self._job.running
        self._find.visible = not running and self._index is None
        self._stop.visible = self._progress.visible = running
        self._track.visible = not running and self._index is not None and bool(self._index.unknown)

    def _use(self, index: BallIndex) -> None:
        self._index = index
        self._show_running()
        for control in (self._conditions, self._opens, self._count, self._table):
            control.visible = True
        self._opens.show(self._mode)
        self._select()

    def _select(self) -> None:
        if self._index is not None:
            self._selection.submit(BallQuery(self._index, str(self._conditions.value)))

    def _found(self, request: BallQuery, rows: NDArray[np.int64]) -> None:
        self._host.later(lambda: self._show_selected(request, rows))

    def _failed(self, error: Exception) -> None:
        """Say it in the panel: conditions are read while they are typed, and half of one is none."""

        def show() -> None:
            if isinstance(error, ConfigError):
                self._count.content = note_html(html_text(str(error)), theme.BAD)
            else:
                self._host.report(error)

        self._host.later(show)

    def _show_selected(self, request: BallQuery, rows: NDArray[np.int64]) -> None:
        if request.index is self._index:
            self._selected, self._first = rows, 0
            self._show_page()

    def _choose_mode(self, chosen: str) -> None:
        def choose() -> None:
            self._mode = next(mode for mode in OPENS_IN if mode == chosen)
            self._opens.show(self._mode)
            self._show_page()

        self._host.later(choose)

    def _turn(self, step: int) -> None:
        last = (max(len(self._selected), 1) - 1) // ROWS * ROWS
        self._first = min(max(self._first + step, 0), last)
        self._show_page()

    def _show_page(self) -> None:
        index = self._index
        if index is None:
            return
        shown = self._selected[self._first : self._first + ROWS]
        rows = index.table.take(shown).to_pylist()
        self._count.content = count_html(index, len(self._selected), self._first)
        links = [self._link(index.source_of(row), values["t_us"]) for row, values in zip(shown, rows, strict=True)]
        self._table.content = balls_html(rows, links)
        self._pages.visible = len(self._selected) > ROWS

    def _link(self, source: BallSource, t_us: int | None) -> str | None:
        if t_us is None or source.kind == "run":
            return None
        # One of a data set, or of a folder beside the workspace, is offered from when it is shown.
        return moment_link(self._host.services.library.add_external(source.path), self._mode, t_us)


def _paths(sources: Sequence[BallSource]) -> tuple[str, ...]:
    return tuple(str(one.path) for one in sources)
