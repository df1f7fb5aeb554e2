"""Comparing methods over a recording in one browser: starts a run, shows its progress and its result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from app.background.jobs import LoopJob, Progress
from app.modes.mode import ModeHost
from app.modes.tune.compare_panel import ComparePanel, CompareSidePanel
from app.modes.tune.compare_run import CompareAnswer, CompareRequest, run_comparison
from app.modes.tune.results_panel import Timing
from app.state.client_state import ClientState
from app.state.commands import Command, LookAt, SetCamera, SetMethod, StopAt
from core.detection.methods import Method
from core.errors import CommandError
from core.metrics.compare import ErrorRun

PROGRESS_EVERY_S: Final = 0.1


class CompareOverTime:
    """Methods are called in the loop."""

    def __init__(self, host: ModeHost, send: Callable[[Command], None], timing: Callable[[], Timing]) -> None:
        """`timing` is asked for what is chosen in the tab Score."""
        self._host = host
        self._timing = timing
        self._job = LoopJob[CompareAnswer](host.later, host.report, lambda: self.panel.show_running(False))
        self._answer: CompareAnswer | None = None
        self._active, self._wanted = False, True
        self._shown_s = float("-inf")
        later, gui = host.later, host.client.gui
        self.panel = ComparePanel(
            gui,
            send,
            lambda: later(self._start),
            lambda: later(self.cancel),
            lambda wanted: later(lambda: self._want(wanted)),
        )
        self._side = CompareSidePanel(gui, later, lambda method, stretch: later(lambda: self._jump(method, stretch)))

    @property
    def answer(self) -> CompareAnswer | None:
        """The last result; None once another recording is open."""
        return self._answer

    @property
    def running(self) -> bool:
        """Whether a comparison is running."""
        return self._job.running

    def show(self, active: bool) -> None:
        """Show or hide the result."""
        self._active = active
        self._side.panel.visible = active and self._wanted and self._answer is not None

    def show_state(self, state: ClientState) -> None:
        """Let the controls follow the state."""
        self.panel.show(state)

    def tick(self, wall_s: float) -> None:
        """Show the progress."""
        share = self._job.share
        if share is not None and wall_s - self._shown_s >= PROGRESS_EVERY_S:
            self._shown_s = wall_s
            self.panel.show_progress(share)

    def cancel(self) -> None:
        """Stop the run without an answer."""
        self._job.cancel()

    def forget(self) -> None:
        """Drop the result: another recording was opened."""
        self.cancel()
        self._answer = None
        self.panel.show_result(False)
        self.show(self._active)

    def close(self) -> None:
        """The browser has disconnected."""
        self._job.close()

    def _start(self) -> None:
        state, recording = self._host.state, self._host.recording
        if state is None or recording is None or self._job.running:
            return
        if not state.tune.compared:
            raise CommandError("no methods to compare", remedy="select some under Compare methods")
        start_us, end_us = _span_of(state, self.panel.span_us)
        timing = self._timing()
        request = CompareRequest(
            recording=state.recording,
            uuid=recording.uuid,
            stream=recording.cameras[state.camera],
            configs=tuple((method, state.config_of(method)) for method in state.tune.compared),
            slot=state.tune.slot,
            agree_with=self.panel.agree_with,
            labels=self._host.services.workspace.labels,
            start_us=start_us,
            end_us=end_us,
            live=state.playhead.live,
            added_us=timing.added_us,
            ends=timing.ends,
        )

        def work(progress: Progress, cancelled: Callable[[], bool]) -> CompareAnswer:
            return run_comparison(request, progress=progress, cancelled=cancelled)

        self.panel.show_running(True)
        self._job.start(work, self._done)

    def _done(self, answer: CompareAnswer) -> None:
        self._answer, self._wanted = answer, True
        with self._host.client.atomic():
            self._side.show(answer)
            self.panel.show_result(True)
            self.show(self._active)

    def _want(self, wanted: bool) -> None:
        self._wanted = wanted
        self.show(self._active)

    def _jump(self, method: Method, stretch: ErrorRun) -> None:
        """Go to the first window of an interval, with its method; a zoomed view follows."""
        state, answer = self._host.state, self._answer
        if state is None or answer is None:
            return
        commands: list[Command] = [StopAt(stretch.look_us), LookAt(stretch.place_px)]
        if state.camera != answer.camera:
            commands.insert(0, SetCamera(answer.camera))
        if not state.tune.side_by_side:
            commands.append(SetMethod(method))
        for command in commands:
            self._host.send(command)


def _span_of(state: ClientState, span_us: int | None) -> tuple[int, int]:
    """Part of the recording to compare: around the cursor, within the recording."""
    head = state.playhead
    if span_us is None:
        return head.start_us, head.duration_us
    middle_us = head.duration_us if head.following else head.anchor_us
    start_us = max(head.start_us, min(middle_us - span_us // 2, head.duration_us - span_us))
    return start_us, min(head.duration_us, start_us + span_us)
