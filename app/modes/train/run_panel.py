"""The shown run: state, controls, and film."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import viser

from app import theme
from app.export.scenes.training_film import export_training_film
from app.export.task import ExportRequest, RunTask
from app.export.unfinished import Cancelled, Progress
from app.modes.mode import download_export, state_html
from app.modes.train.form import PACES
from app.modes.train.status import status_html
from app.modes.train.view import Details, RunsView
from app.widgets import Listing, when_clicked
from core.learning.runs.run_files import RunCommand

NEWEST: Final = "the newest"
LAST_ONES: Final = "the last three"
NOBODY: Final = "nothing"
NO_RALLY_HTML: Final = (
    f"<div style='font-size:12.5px;padding:4px 12px;color:{theme.MUTED}'>It plays the training's serves: there is no "
    "live rally with a robot here. Start Rallyscope without a recording, or with <code>--source tcp://...</code>.</div>"
)


class RunActions(Protocol):
    """Actions of this panel; thread-safe."""

    def train_now(self) -> None: ...
    def train_curriculum(self) -> None: ...
    def ask(self, command: RunCommand) -> None: ...
    def ask_to_stop(self) -> None: ...
    def resume(self) -> None: ...
    def set_pace(self, pace: str) -> None: ...
    def let_play(self) -> None: ...
    def choose_run(self, name: str) -> None: ...
    def compare_with(self, name: str) -> None: ...


class RunPanel:
    """The controls of a training, for one browser."""

    def __init__(self, gui: viser.GuiApi, actions: RunActions) -> None:
        self._gui = gui
        self._now = gui.add_button(
            "Train now",
            icon=viser.Icon.PLAYER_PLAY_FILLED,
            color="teal",
            hint="A hundred balls at 5 m/s, slow enough to watch: it learns to place balls in a minute",
        )
        self._curriculum = gui.add_button(
            "Train the curriculum (3, then 5 m/s)",
            icon=viser.Icon.STAIRS_UP,
            hint="The paper's agent: 800 slow balls, of which the good ones are kept, then 900 fast ones. Some 10 s "
            "of computing; Pace slows it down to watch",
        )
        self._status = gui.add_html("")
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE, visible=False)
        self._go_on = gui.add_button("Continue", icon=viser.Icon.PLAYER_PLAY, visible=False)
        self._resume = gui.add_button("Resume", icon=viser.Icon.PLAYER_TRACK_NEXT, visible=False)
        self._stop = gui.add_button("Stop", icon=viser.Icon.PLAYER_STOP, color="red", visible=False)
        self._play = gui.add_button(
            "Let it play",
            icon=viser.Icon.PING_PONG,
            color="green",
            visible=False,
            hint="Its policy plays the live rally, in Watch; where there is none, the training's serves in the 3D view",
        )
        self._why_not = gui.add_html(NO_RALLY_HTML, visible=False)
        self._pace = Listing(gui, "Pace", actions.set_pace, hint="Limit the training's speed to watch it")
        self._pace.offer(tuple(PACES))
        self._runs = Listing(gui, "Run", actions.choose_run, hint="The run whose curves, landings and balls are shown")
        self._runs.offer((NEWEST,))
        self._compared = Listing(gui, "Compare with", actions.compare_with, hint="Curves of other runs beside it")
        self._compared.offer((LAST_ONES, NOBODY))
        when_clicked(self._now, actions.train_now)
        when_clicked(self._curriculum, actions.train_curriculum)
        when_clicked(self._pause, lambda: actions.ask("pause"))
        when_clicked(self._go_on, lambda: actions.ask("run"))
        when_clicked(self._resume, actions.resume)
        when_clicked(self._stop, actions.ask_to_stop)
        when_clicked(self._play, actions.let_play)

    def show(self, view: RunsView, details: Details | None, *, has_rally: bool) -> None:
        """Update the status; the buttons act on the running training, or else on the shown run.

        `has_rally`: there is a live rally that a policy can play.
        """
        runs, run = view.runs, view.run
        active = next((state for state in runs if state.active), None)
        names = tuple(state.name for state in runs)
        self._runs.offer((NEWEST, *names))
        self._compared.offer((LAST_ONES, NOBODY, *names))
        self._status.content = status_html(run, details, active, view.bounds)
        self._now.visible = self._curriculum.visible = active is None
        self._pause.visible = active is not None and active.phase == "running"
        self._go_on.visible = active is not None and active.phase == "paused"
        self._stop.visible = active is not None and active.phase not in ("stopping", "ending")
        self._resume.visible = active is None and run is not None and run.resumable
        self._play.visible = view.playable
        self._why_not.visible = view.playable and not has_rally
        self._progress.visible = active is not None
        if active is not None:
            status = None if active.phase == "starting" else active.status
            self._progress.animated = status is None
            self._progress.value = 100.0 if status is None else 100.0 * status.share
            pace = next((name for name, rate in PACES.items() if rate == active.episodes_per_s), None)
            self._pace.show(pace or next(iter(PACES)))

    def show_run(self, name: str | None) -> None:
        """Show which run is chosen; None: the newest."""
        self._runs.show(name or NEWEST)

    def show_pace(self, pace: str) -> None:
        """Show the speed of the training."""
        self._pace.show(pace)


def confirm_stop(gui: viser.GuiApi, name: str, stop: Callable[[], None]) -> None:
    """Ask before a training is stopped."""
    modal = gui.add_modal(f"Stop {name}?")
    with modal:
        gui.add_markdown("It can be resumed later; its progress is kept.")
        yes = gui.add_button("Yes, stop it", icon=viser.Icon.PLAYER_STOP, color="red")
        no = gui.add_button("No, continue", icon=viser.Icon.PLAYER_PLAY)

    def end() -> None:
        modal.close()
        stop()

    when_clicked(yes, end)
    when_clicked(no, modal.close)


if TYPE_CHECKING:
    from app.modes.mode import ModeHost  # the modes import this file

LOOK_EVERY_S: Final = 0.3
Shown = tuple[str, int] | None
"""A run and one of its seeds."""


class FilmPanel:
    """Film controls of one browser; the export is shared by all. Methods are called by the loop."""

    def __init__(self, host: ModeHost, shown: Callable[[], Shown]) -> None:
        self._host = host
        self._exporter = host.services.exporter
        self._shown = shown
        self._film: str | None = None
        """Last film requested here."""
        self._looked_s = float("-inf")
        gui = host.client.gui
        self._make = gui.add_button(
            "Film of this training",
            icon=viser.Icon.MOVIE,
            hint="Every 10th ball from the first to the last, as a film among the exports",
        )
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel the film", icon=viser.Icon.X, color="red", visible=False)
        self._status = gui.add_html("", visible=False)
        self._download = gui.add_button("Download the film", icon=viser.Icon.FILE_DOWNLOAD, visible=False)
        when_clicked(self._make, lambda: host.later(self._start))
        when_clicked(self._cancel, lambda: host.later(self._stop))
        when_clicked(self._download, lambda: host.later(self._send))

    def tick(self, wall_s: float) -> None:
        """Update the film's progress."""
        if wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        state = self._exporter.state()
        ours = state is not None and state.name == self._film
        running = ours and state is not None and state.running
        self._make.visible = self._shown() is not None and not running
        self._progress.visible = self._cancel.visible = running
        self._status.visible = ours
        self._download.visible = self._film is not None and not running and self._is_made()
        if state is not None and ours:
            self._progress.value = 100.0 * state.share
            self._status.content = state_html(state)

    def _is_made(self) -> bool:
        return self._film is not None and (self._host.services.workspace.exports / self._film).is_file()

    def _start(self) -> None:
        shown = self._shown()
        if shown is None:
            return
        name, seed = shown
        run = self._host.services.workspace.run_path(name)

        def work(path: Path, progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
            order = ExportRequest(format="mp4", destination=path, seed=seed)
            return export_training_film(RunTask(order, run, progress, cancelled))

        self._film = self._exporter.start(f"{name}-film", ".mp4", work)
        self._looked_s = float("-inf")

    def _stop(self) -> None:
        state = self._exporter.state()
        if state is not None and state.name == self._film:  # not another browser's export
            self._exporter.cancel()
            self._looked_s = float("-inf")

    def _send(self) -> None:
        if self._film is not None:
            download_export(self._host, self._film)
