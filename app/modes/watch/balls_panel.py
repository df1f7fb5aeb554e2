"""Find a ball again: the index of all recordings, data sets and runs, conditions, points and a page of the list."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app import theme
from app.background.jobs import LatestWins, LoopJob, Progress
from app.formatting import html_text, note_html
from app.modes.mode import ModeHost
from app.modes.watch.ball_list import ROWS, BallQuery, BallView, link_of_row, scatter_html, selection_text, view_balls
from app.modes.watch.ball_scatter import AXES, ScatterAxes, row_at, rows_within, title_of
from app.modes.watch.selection_panel import BallSelectionPanel
from app.shared.ball_index import BallIndex, BallSource, ball_sources, index_balls, moved_rows
from app.state.client_state import ModeName
from app.web.pages import Message
from app.widgets import Choice, Listing, when_changed, when_clicked
from core.errors import CommandError, ConfigError

OPENS_IN: Final[tuple[ModeName, ...]] = ("Watch", "Tune", "Label")
LOOK_EVERY_S: Final = 5.0
"""Interval at which new recordings and runs are looked for, once somebody has asked for the balls."""


@dataclass(frozen=True, slots=True)
class _Places:
    """Where sources are looked for."""

    root: Path
    others: tuple[Path, ...]


class BallsPanel:
    """The balls of one browser. Methods are called by its loop; listing, indexing and drawing are done off it."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._index: BallIndex | None = None
        self._view: BallView | None = None
        self._axes = ScatterAxes()
        self._marked: NDArray[np.int64] | None = None
        """Rows of the index that a line was drawn round."""
        self._first = 0
        self._opened = 0
        self._mode: ModeName = OPENS_IN[0]
        self._known: object = None
        self._looked_s = 0.0
        self._job: LoopJob[BallIndex] = LoopJob(host.later, host.report, self._show_running)
        self._views = LatestWins(host.pool, view_balls, self._viewed, self._failed)
        self._looks = LatestWins(host.pool, _list_sources, self._listed, self._failed)
        with gui.add_folder("Balls", expand_by_default=False):
            hint = "Every flight, bounce and stroke of all recordings, data sets and runs of this workspace"
            self._find = gui.add_button("Find balls", icon=viser.Icon.SEARCH, hint=hint)
            self._stop = gui.add_button("Stop", icon=viser.Icon.X, visible=False)
            self._progress = gui.add_progress_bar(0.0, visible=False)
            hint = "Such as: kind=stroke outcome=net|out speed_mps=5..7 spin_radps=50.. name=demo"
            self._conditions = gui.add_text("Conditions", "", hint=hint, visible=False)
            self._x = self._axis(gui, "Across", "x", "What the points are drawn by, from left to right")
            self._y = self._axis(gui, "Up", "y", "What the points are drawn by, from bottom to top")
            self._colour = self._axis(gui, "Colour by", "colour", "What the colours of the points mean")
            self._points = gui.add_html("", visible=False)
            self._clear = gui.add_button("Show all again", icon=viser.Icon.LASSO, visible=False)
            self._opens = Choice(gui, "Open in", OPENS_IN, self._choose_mode, hint="Where a click shows the moment")
            self._opens.visible = False
            self._count = gui.add_html("", visible=False)
            self._table = gui.add_html("", visible=False)
            self._pages = gui.add_button_group("Page", ("Previous", "Next"), visible=False)
            self._use_as = BallSelectionPanel(gui, host)
            hint = "Runs the tracker over each of them, which takes about as long as they last, or longer"
            self._track = gui.add_button("Track the unknown recordings", visible=False, hint=hint)
        when_clicked(self._find, lambda: host.later(self._start))
        when_clicked(self._track, lambda: host.later(lambda: self._start(track=True)))
        when_clicked(self._stop, lambda: host.later(self._job.cancel))
        when_clicked(self._clear, lambda: host.later(lambda: self._mark(None)))
        when_changed(self._conditions, lambda _: host.later(lambda: self._show(first=0)))
        host.listen("ball_point", self._point_clicked)
        host.listen("ball_outline", self._outlined)

        @self._pages.on_click
        async def _(event: viser.GuiEvent) -> None:
            step = ROWS if event.target.value == "Next" else -ROWS
            host.later(lambda: self._show(first=self._first + step))

    def _axis(self, gui: viser.GuiApi, label: str, axis: str, hint: str) -> Listing:
        def choose(title: str) -> None:
            if title in AXES:
                self._host.later(lambda: self._set_axis(axis, AXES[title]))

        listing = Listing(gui, label, choose, hint=hint)
        listing.offer(tuple(AXES))
        listing.show(title_of(getattr(self._axes, axis)))
        listing.visible = False
        return listing

    def tick(self, wall_s: float) -> None:
        """Show the progress, and have it looked whether recordings or runs have come or gone."""
        if self._job.share is not None and abs(self._progress.value - 100 * self._job.share) >= 1:
            self._progress.value = 100 * self._job.share
        self._use_as.tick()
        if self._index is None or self._job.running or wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        self._looks.submit(self._places())

    def close(self) -> None:
        """The browser has disconnected."""
        for work in (self._job, self._views, self._looks, self._use_as):
            work.close()

    def _places(self) -> _Places:
        return _Places(self._host.services.workspace.root, tuple(self._host.services.library.folders))

    def _listed(self, _: _Places, sources: tuple[BallSource, ...]) -> None:
        def compare() -> None:
            if self._index is not None and not self._job.running and _paths(sources) != self._known:
                self._start()

        self._host.later(compare)

    def _start(self, *, track: bool = False) -> None:
        places = self._places()

        def work(progress: Progress, cancelled: Callable[[], bool]) -> BallIndex:
            sources = _list_sources(places)
            if not sources and self._index is None:
                raise CommandError("no recordings and no runs yet", remedy="record, simulate or open one")
            self._known = _paths(sources)
            return index_balls(sources, places.root, track=track, progress=progress, cancelled=cancelled)

        self._job.start(work, self._use)
        self._show_running()

    def _show_running(self) -> None:
        running = self._job.running
        self._find.visible = not running and self._index is None
        self._stop.visible = self._progress.visible = running
        self._track.visible = not running and self._index is not None and bool(self._index.unknown)

    def _use(self, index: BallIndex) -> None:
        if self._index is not None and self._marked is not None:
            self._marked = moved_rows(self._marked, self._index, index)
        self._index = index
        self._show_running()
        for control in (self._conditions, self._x, self._y, self._colour, self._points, self._count, self._table):
            control.visible = True
        self._opens.visible = True
        self._opens.show(self._mode)
        self._show(first=self._first)

    def _set_axis(self, axis: str, column: str) -> None:
        self._axes = replace(self._axes, **{axis: column})
        self._show(first=self._first)

    def _mark(self, rows: NDArray[np.int64] | None) -> None:
        self._marked = rows
        self._show(first=0)

    def _show(self, *, first: int) -> None:
        """Have what is chosen drawn anew."""
        if self._index is not None:
            self._first = first
            self._views.submit(self._query(self._index))

    def _query(self, index: BallIndex) -> BallQuery:
        def name_of(source: BallSource) -> str:
            # One of a data set, or of a folder beside the workspace, is offered from when it is shown.
            return self._host.services.library.add_external(source.path)

        conditions = str(self._conditions.value)
        return BallQuery(index, conditions, self._axes, self._marked, self._first, self._mode, name_of)

    def _viewed(self, request: BallQuery, view: BallView) -> None:
        self._host.later(lambda: self._show_view(request, view))

    def _failed(self, error: Exception) -> None:
        """Say it in the panel: conditions are read while they are typed, and half of one is none."""

        def show() -> None:
            if isinstance(error, ConfigError):
                self._count.content = note_html(html_text(str(error)), theme.BAD)
            else:
                self._host.report(error)

        self._host.later(show)

    def _show_view(self, request: BallQuery, view: BallView) -> None:
        if request.index is not self._index:
            return
        self._view, self._first = view, view.first
        self._points.content, self._count.content, self._table.content = scatter_html(view), view.count, view.table
        self._pages.visible = len(view.rows) > ROWS
        self._clear.visible = request.selected is not None
        self._use_as.offer(request.index, view.rows, selection_text(request))

    def _choose_mode(self, chosen: str) -> None:
        def choose() -> None:
            self._mode = next(mode for mode in OPENS_IN if mode == chosen)
            self._opens.show(self._mode)
            self._show(first=self._first)

        self._host.later(choose)

    def _point_clicked(self, message: Message) -> None:
        """Open the moment of the point there; beside all points, show all again."""
        places, index = _places_of([message.get("at")]), self._index
        if self._view is None or index is None or not places:
            return
        row = row_at(self._view.scatter, *places[0])
        if row is None:
            self._mark(None)
            return
        link = link_of_row(self._query(index), row)
        if link is None:
            self._host.say("A ball of a training run has no recording to open")
            return
        self._opened += 1
        self._host.send_to_page("open_ball", {"link": link, "number": self._opened})

    def _outlined(self, message: Message) -> None:
        """Select what is within the line; with Shift beside what is selected."""
        outline = message.get("outline")
        places = _places_of(outline) if isinstance(outline, list) else []
        if self._view is None or not places:
            return
        rows = rows_within(self._view.scatter, places)
        if message.get("more") is True and self._marked is not None:
            rows = np.union1d(rows, self._marked)
        self._mark(rows if len(rows) else None)


def _list_sources(places: _Places) -> tuple[BallSource, ...]:
    return ball_sources(places.root, places.others)


def _paths(sources: Iterable[BallSource]) -> tuple[str, ...]:
    return tuple(f"{one.path} {one.seed}" for one in sources)


def _places_of(values: list) -> list[tuple[float, float]]:
    """Places (shares of the picture's width and height) of a message of the page; none if one is not a place."""
    found = []
    for value in values:
        numbers = value if isinstance(value, list) and len(value) == 2 else []
        if not all(isinstance(one, (int, float)) and math.isfinite(one) and 0 <= one <= 1 for one in numbers):
            return []
        found += [(float(numbers[0]), float(numbers[1]))] if numbers else []
    return found
