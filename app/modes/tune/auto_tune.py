"""Automatic tuning in one browser: starts a search, shows its progress, and puts the result into config B."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import Final, cast, get_args

import viser

from app.background.jobs import LoopJob, Progress
from app.formatting import html_text
from app.modes.mode import ModeHost
from app.modes.tune.auto_run import AutoTuneAnswer, AutoTuneRequest, report_html, run_auto_tune, running_html
from app.modes.tune.results_panel import Timing
from app.modes.tune.settings import stage_counts_html
from app.panels.field_control import field_label, section_title
from app.state.client_state import Configs
from app.state.commands import UseBeside
from app.state.config_words import changed_settings, config_words
from app.widgets import when_clicked
from core.config import field_specs
from core.detection import DetectorConfig
from core.detection.methods import METHODS, Method, method_config
from core.errors import CommandError
from core.files import usable_cores
from core.tuning import TuningConfig, choose_parameters
from core.tuning.parameters import tunable_parameters
from labels.tuning_objective import Against

MAX_TRIALS: Final = 5000
LARGEST_SEED: Final = 2**31 - 1


@dataclass(frozen=True, slots=True)
class AutoTuneForm:
    """Values of the controls."""

    method: Method
    against: Against
    parameters: tuple[str, ...]
    trials: int
    seed: int
    all_cameras: bool
    in_time: bool
    """Whether the newest answers are scored, with the extra latency of the tab Score."""
    place: str


class AutoTunePanel:
    """Controls of auto-tune in one browser; `start` and `cancel` are called from viser's event loop."""

    def __init__(
        self, gui: viser.GuiApi, start: Callable[[], None], cancel: Callable[[], None], places: tuple[str, ...]
    ) -> None:
        self.folder = gui.add_folder("Auto-tune", expand_by_default=False)
        config = TuningConfig()
        with self.folder:
            self._against = gui.add_dropdown("Against", get_args(Against), hint="Reference")
            self._trials = gui.add_number("Trials", config.trials, min=1, max=MAX_TRIALS, step=1)
            self._seed = gui.add_number("Seed", config.seed, min=0, max=LARGEST_SEED, step=1)
            self._all_cameras = gui.add_checkbox("All cameras", True, hint="All cameras, or only the shown one")
            self._in_time = gui.add_checkbox(
                "Score in time",
                False,
                hint="What the newest answer is worth to a robot, with the Extra latency of Score; needs the truth",
            )
            self._place = gui.add_dropdown("Where", places, visible=len(places) > 1, hint="Machine for the trials")
            self._start = gui.add_button(
                "Tune automatically",
                icon=viser.Icon.WAND,
                color="teal",
                hint="Starts from config A of the chosen method; the result is config B",
            )
            self._cancel = gui.add_button("Cancel tuning", icon=viser.Icon.X, visible=False)
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._line = gui.add_html("", visible=False)
            self._ticks, self._sections = _add_ticks(gui)
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)
        self._method: Method | None = None
        self.use_method(next(iter(METHODS)))

    @property
    def form(self) -> AutoTuneForm:
        """Values of the controls, checked.

        Raises:
            CommandError: if no threshold is chosen, or a value is none that the controls offer.
        """
        method, against = self._method, str(self._against.value)
        assert method is not None
        if against not in get_args(Against):
            raise CommandError("no such choice", got=against[:20])
        chosen = tuple(name for name, tick in self._ticks.items() if tick.visible and tick.value)
        if not chosen:
            raise CommandError("no thresholds to tune", remedy="select some under Thresholds")
        trials, seed = _integer(self._trials.value, 1, MAX_TRIALS), _integer(self._seed.value, 0, LARGEST_SEED)
        return AutoTuneForm(
            method,
            cast(Against, against),
            chosen,
            trials,
            seed,
            bool(self._all_cameras.value),
            bool(self._in_time.value),
            str(self._place.value),
        )

    def show_running(self, running: bool) -> None:
        """Swap the start button for progress and cancel."""
        self._start.visible = not running
        self._cancel.visible = self._progress.visible = self._line.visible = running
        self._progress.value = 0.0
        self._line.content = stage_counts_html("reading the recording")

    def show_progress(self, share: float, line: str) -> None:
        """Show the progress as a bar and a text."""
        self._progress.value = 100.0 * share
        if line:
            self._line.content = stage_counts_html(line)

    def use_method(self, method: Method) -> None:
        """Offer the thresholds of a method, with its defaults ticked; ticks stay while the method stays."""
        if method == self._method:
            return
        self._method = method
        start = method_config(method)
        offered = {parameter.name for parameter in tunable_parameters(method, start)}
        usual = {parameter.name for parameter in choose_parameters(method, start)}
        for name, tick in self._ticks.items():
            tick.visible, tick.value = name in offered, name in usual
        for section, folder in self._sections.items():
            folder.visible = any(name.startswith(f"{section}.") for name in offered)


def _integer(value: object, low: int, high: int) -> int:
    """Whole number in a range, from a value that a browser sent."""
    if not isinstance(value, (int, float)) or not low <= value <= high:
        raise CommandError("not a possible number", expected=f"{low} to {high}", got=repr(value)[:20])
    return int(value)


def _add_ticks(gui: viser.GuiApi) -> tuple[dict[str, viser.GuiCheckboxHandle], dict[str, viser.GuiFolderHandle]]:
    """A check box for every threshold of every method, by name, in a folder for each section."""
    ticks: dict[str, viser.GuiCheckboxHandle] = {}
    sections: dict[str, viser.GuiFolderHandle] = {}
    with gui.add_folder("Thresholds", expand_by_default=False):
        for section, specs in groupby(field_specs(DetectorConfig), lambda spec: spec.path[0]):
            sections[section] = gui.add_folder(section_title((section,)), expand_by_default=False)
            with sections[section]:
                for spec in specs:
                    ticks[".".join(spec.path)] = gui.add_checkbox(f"Tune {field_label(spec)}", False, hint=spec.doc)
    return ticks, sections


PROGRESS_EVERY_S: Final = 0.1


def trial_words(line: str) -> str:
    """Progress of the search, such as "trial 12 of 24, best 0.956", from a line of `rallyscope tune`."""
    return re.sub(r"^\D*(\d+) of (\d+) trials", r"trial \1 of \2", line)


def loses_config(method: Method, configs: Configs) -> bool:
    """Whether config B has settings that are neither the method's defaults nor those of A."""
    return bool(changed_settings(method, configs.b)) and configs.b != configs.a


def confirm_overwrite(gui: viser.GuiApi, config: str, start: Callable[[], None]) -> None:
    """Ask before config B is replaced by what will be found."""
    modal = gui.add_modal("Overwrite config B?")
    with modal:
        gui.add_html(f"<div>The result becomes config B. B now is: {html_text(config)}. Undo brings it back.</div>")
        overwrite = gui.add_button("Overwrite B", icon=viser.Icon.WAND, color="teal")
        keep = gui.add_button("Keep B", icon=viser.Icon.X)

    def begin() -> None:
        modal.close()
        start()

    when_clicked(overwrite, begin)
    when_clicked(keep, modal.close)


class AutoTune:
    """Methods are called in the loop. `show_result` is given what to show of a search."""

    def __init__(self, host: ModeHost, show_result: Callable[[str], None], timing: Callable[[], Timing]) -> None:
        """`timing` is asked for what is chosen in the tab Score."""
        self._host = host
        self._timing = timing
        self._show_result = show_result
        self._job = LoopJob[AutoTuneAnswer](host.later, host.report, lambda: self.panel.show_running(False))
        self._request: AutoTuneRequest | None = None
        self._line = ""
        self._shown_s = float("-inf")
        later = host.later
        places = host.services.places.offered
        self.panel = AutoTunePanel(host.client.gui, lambda: later(self._start), lambda: later(self.cancel), places)

    @property
    def running(self) -> bool:
        """Whether a search is running."""
        return self._job.running

    def tick(self, wall_s: float) -> None:
        """Show the progress."""
        share = self._job.share
        if share is not None and wall_s - self._shown_s >= PROGRESS_EVERY_S:
            self._shown_s = wall_s
            self.panel.show_progress(share, self._line)
            if self._line and self._request is not None:
                self._show_result(running_html(self._request.title, trial_words(self._line)))

    def cancel(self) -> None:
        """Stop the search without an answer."""
        if self._job.running:
            self._show_result(stage_counts_html("tuning was cancelled: A and B are as they were"))
        self._job.cancel()

    def close(self) -> None:
        """The browser has disconnected."""
        self._job.close()

    def _start(self) -> None:
        state, recording = self._host.state, self._host.recording
        if state is None or recording is None or self._job.running:
            return
        form, timing = self.panel.form, self._timing()
        early = f", windows end {timing.ends.words}" if timing.ends.words else ""
        request = AutoTuneRequest(
            title=f"{form.method}, {state.recording}, {'all cameras' if form.all_cameras else state.camera}{early}",
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
            added_us=timing.added_us if form.in_time else None,
            ends=timing.ends,
            where=self._host.services.places.flags(form.place, max(1, usable_cores() - 1)),
        )

        configs = state.history_of(form.method).present
        if loses_config(form.method, configs):
            confirm_overwrite(
                self._host.client.gui,
                config_words(form.method, "B", configs.b),
                lambda: self._host.later(lambda: self._run(request)),
            )
            return
        self._run(request)

    def _run(self, request: AutoTuneRequest) -> None:
        if self._job.running:
            return

        def work(progress: Progress, cancelled: Callable[[], bool]) -> AutoTuneAnswer:
            return run_auto_tune(request, progress=progress, say=say, cancelled=cancelled)

        def say(line: str) -> None:
            if self._request is request:
                self._line = line

        self._line, self._request = "", request
        self._show_result(running_html(request.title))
        self.panel.show_running(True)
        self._job.start(work, lambda answer: self._done(request, answer))

    def _done(self, request: AutoTuneRequest, answer: AutoTuneAnswer) -> None:
        self._show_result(report_html(f"{request.title}, against {request.against}", answer.report))
        self._host.send(UseBeside(request.method, request.start, answer.config))
        self._host.note("Tuned", "The result is config B, beside A; the tab Auto-tune has the figures.", "green")
