"""A film of the training that is shown, by one button: how it goes, and the file once it is made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import viser

from app.export.scenes.training_film import export_training_film
from app.export.unfinished import Cancelled, Progress
from app.modes.download import download_export, state_html
from app.widgets import when_clicked

if TYPE_CHECKING:
    from app.modes.mode import ModeHost  # the modes import this file

LOOK_EVERY_S: Final = 0.3
Shown = tuple[str, int] | None
"""A run and one of its seeds."""


class FilmPanel:
    """For one browser; the film is one of the exports that all share. Methods are called by the loop."""

    def __init__(self, host: ModeHost, shown: Callable[[], Shown]) -> None:
        self._host = host
        self._exporter = host.services.exporter
        self._shown = shown
        self._film: str | None = None
        """The one that was asked for here last."""
        self._looked_s = float("-inf")
        gui = host.client.gui
        self._make = gui.add_button(
            "Film of this training",
            icon=viser.Icon.MOVIE,
            hint="Every 10th ball from the first to the last, as a film; it lands among the exports",
        )
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel the film", icon=viser.Icon.X, color="red", visible=False)
        self._status = gui.add_html("", visible=False)
        self._download = gui.add_button("Download the film", icon=viser.Icon.FILE_DOWNLOAD, visible=False)
        when_clicked(self._make, lambda: host.later(self._start))
        when_clicked(self._cancel, lambda: host.later(self._stop))
        when_clicked(self._download, lambda: host.later(self._send))

    def tick(self, wall_s: float) -> None:
        """Follow the film."""
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
            return (export_training_film(run, path, seed=seed, progress=progress, cancelled=cancelled),)

        self._film = self._exporter.start(f"{name}-film", ".mp4", work)
        self._looked_s = float("-inf")

    def _stop(self) -> None:
        state = self._exporter.state()
        if state is not None and state.name == self._film:  # never another's export
            self._exporter.cancel()
            self._looked_s = float("-inf")

    def _send(self) -> None:
        if self._film is not None:
            download_export(self._host, self._film)
