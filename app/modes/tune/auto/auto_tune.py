"""Automatic tuning in one browser: starts a search, follows it, and puts what it found into config B."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from app.background.jobs import Job, Progress
from app.modes.mode import ModeHost
from app.modes.tune.auto.panel import AutoTunePanel
from app.modes.tune.auto.report import report_html
from app.modes.tune.auto.run import AutoTuneAnswer, AutoTuneRequest, run_auto_tune
from app.state.commands import UseBeside
from core.files import usable_cores

PROGRESS_EVERY_S: Final = 0.1


class AutoTune:
    """Methods are called in the loop. `show_result` is given what to show of a search."""

    def __init__(self, host: ModeHost, show_result: Callable[[str], None]) -> None:
        self._host = host
        self._show_result = show_result
        self._job: Job[AutoTuneAnswer] | None = None
        self._request: AutoTuneRequest | None = None
        self._line = ""
        self._shown_s = float("-inf")
        later = host.later
        places = host.services.places.offered
        self.panel = AutoTunePanel(host.client.gui, lambda: later(self._start), lambda: later(self.cancel), places)

    @property
    def running(self) -> bool:
        """A search goes on."""
        return self._job is not None

    def tick(self, wall_s: float) -> None:
        """Show how far it is."""
        if self._job is not None and wall_s - self._shown_s >= PROGRESS_EVERY_S:
            self._shown_s = wall_s
            self.panel.show_progress(self._job.share, self._line)

    def cancel(self) -> None:
        """End the search without an answer."""
        if self._job is not None:
            self._job.cancel()
            self._end()

    def close(self) -> None:
        """The browser is gone, and its controls with it."""
        if self._job is not None:
            self._job.cancel()

    def _start(self) -> None:
        state, recording = self._host.state, self._host.recording
        if state is None or recording is None or self._job is not None:
            return
        form, later = self.panel.form, self._host.later
        request = AutoTuneRequest(
            title=f"{state.recording}, {'all cameras' if form.all_cameras else state.camera}, {form.method}",
            recording=self._host.services.library.file_of(state.recording),
            uuid=recording.uuid,
            camera=state.camera,
            all_cameras=form.all_cameras,
            method=form.method,
            against=form.against,
            labels=self._host.services.workspace.labels,
            parameters=form.parameters,
            trials=form.trials,
            seed=form.seed,
            start=state.history_of(form.method).present.a,
            where=self._host.services.places.flags(form.place, max(1, usable_cores() - 1)),
        )

        def work(progress: Progress, cancelled: Callable[[], bool]) -> AutoTuneAnswer:
            return run_auto_tune(request, progress=progress, say=say, cancelled=cancelled)

        def say(line: str) -> None:
            if self._request is request:
                self._line = line

        self._line, self._request = "", request
        self.panel.show_running(True)
        self._job = Job(
            work,
            lambda answer: later(lambda: self._done(request, answer)),
            lambda error: later(lambda: self._failed(request, error)),
        )

    def _done(self, request: AutoTuneRequest, answer: AutoTuneAnswer) -> None:
        if self._request is not request:  # it was cancelled just then
            return
        self._end()
        self._show_result(report_html(f"{request.title}, against {request.against}", answer.report))
        self._host.send(UseBeside(request.method, request.start, answer.config))
        self._host.note("Tuned", "The result is config B, beside A; the tab Auto-tune has the figures.", "green")

    def _failed(self, request: AutoTuneRequest, error: Exception) -> None:
        if self._request is request:
            self._end()
            self._host.report(error)

    def _end(self) -> None:
        self._job = self._request = None
        self.panel.show_running(False)
