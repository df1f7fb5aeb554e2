"""Train: start a training, watch its balls in 3D, its curves and its landings, while it runs in its own process."""

from __future__ import annotations

import time
from contextlib import nullcontext
from typing import Final

from app.background.jobs import LatestWins
from app.modes.mode import Middle, ModeHost
from app.modes.train.form import PACES, PRESETS, THE_CURRICULUM, TRAIN_NOW, FormPanel, Preset, startable_run
from app.modes.train.maps import MapRequest, MapView, MapViewer, map_request
from app.modes.train.run_panel import LAST_ONES, NEWEST, NOBODY, FilmPanel, RunPanel, confirm_stop
from app.modes.train.side_panel import SidePanel
from app.modes.train.status import learned_text
from app.modes.train.training_scene import TrainingScene
from app.modes.train.view import Details, RunsView, RunsViewer, ViewRequest
from app.shared.job_backends import THIS_MACHINE
from app.shared.live_rally import LIVE
from app.shared.rallies import let_play
from app.shared.trainer import RunPhase
from app.shared.training_records import Replay
from app.state.client_state import ClientState
from app.state.commands import SetMode
from core.errors import RallyscopeError
from core.learning.config import RunConfig
from core.learning.runs.run_files import RunCommand
from core.recordings import Recording

LOOK_EVERY_S: Final = 0.5
AFTER_FAILURE_S: Final = 10.0


class TrainMode:
    """The Train mode of one browser; the training itself is shared by all."""

    uses_recording = False
    takes_keys = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._trainer = host.services.trainer
        viewer = RunsViewer(host.services.workspace, self._trainer, host.services.metrics)
        self._viewer = LatestWins(host.pool, viewer, self._viewed, self._failed)
        self._maps = LatestWins(host.pool, MapViewer(host.services.workspace), self._mapped, self._failed)
        self._map_key: object = None
        self._chosen: str | None = None
        self._compared: tuple[str, ...] | None = None
        self._view: RunsView | None = None
        self._details: Details | None = None
        self._phases: dict[str, RunPhase] = {}
        self._asked_s = float("-inf")
        self._waiting = self._active = False
        self._pace = next(iter(PACES))
        gui = host.client.gui
        self._folder = gui.add_folder(None, visible=False)
        with self._folder:
            self._run_panel = RunPanel(gui, self)
            self._film_panel = FilmPanel(host, self._filmed)
            with gui.add_folder("A new training", expand_by_default=False):
                self._form_panel = FormPanel(
                    gui, self._start_form, self._choose_preset, host.later, host.services.places.offered
                )
            with gui.add_folder("In the 3D view"):
                self._scene = TrainingScene(host, self._failed)
        self._side = SidePanel(gui)

    # Of a mode ----------------------------------------------------------------------------------------------------

    @property
    def middle(self) -> Middle:
        """The table in 3D."""
        return "world"

    @property
    def needs_tick(self) -> bool:
        """Whether balls fly or a training runs."""
        return self._view is not None and self._view.run is not None

    @property
    def details(self) -> Details | None:
        """Details of the chosen run."""
        return self._details

    @property
    def replay(self) -> Replay | None:
        """Replay of the ball in the scene."""
        return self._scene.replay

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._active = active
        self._folder.visible = active
        self._side.set_visible(active)
        self._asked_s = float("-inf")
        if active:
            self._scene.clear()

    def use_recording(self, recording: Recording) -> None:
        """Do nothing: trainings do not depend on recordings."""

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Update the runs twice a second; move the ball."""
        if not self._waiting and wall_s - self._asked_s >= LOOK_EVERY_S:
            self._asked_s, self._waiting = wall_s, True
            shown = None if self._view is None or self._details is None else self._view.key
            self._viewer.submit(ViewRequest(self._chosen, self._compared, shown))
        self._film_panel.tick(wall_s)
        self._side.room.follow(self._host.client.camera.aspect)
        view, details = self._view, self._details
        if view is not None and view.run is not None and details is not None:
            self._scene.draw(wall_s, self._host.services.workspace.run_path(view.run.name), view.run.config, details)

    def clicked(self, x: float, y: float) -> None:
        """Do nothing: Train has no clickable pictures."""

    def close(self) -> None:
        """The browser has disconnected; the training continues."""
        self._viewer.close()
        self._maps.close()
        self._scene.close()

    # What is shown ------------------------------------------------------------------------------------------------

    def _viewed(self, request: ViewRequest, view: RunsView) -> None:
        self._host.later(lambda: self._show(request, view))

    def _show(self, request: ViewRequest, view: RunsView) -> None:
        self._waiting = False
        if not self._active:
            return  # it is asked for again: a chart that is made while it is hidden has neither axes nor grid
        if request.run != self._chosen or request.compared != self._compared:
            self._asked_s = float("-inf")
            return
        before, self._view = self._view, view
        if view.run is None or before is None or before.run is None or before.run.name != view.run.name:
            self._scene.clear()
        if view.details is not None or view.run is None:
            self._details = view.details
        with self._host.client.atomic():
            live = self._host.services.rallies.live
            self._run_panel.show(view, self._details, has_rally=live is not None and live.has_robot)
            self._side.show(view, self._details)
            self._scene.explain(view.run, self._details)
        if view.run is not None and self._details is not None:
            self._maps.submit(map_request(view.run, self._details, self._map_key))
        self._tell_ends(view)

    def _mapped(self, request: MapRequest, view: MapView | None) -> None:
        if view is not None:
            self._host.later(lambda: self._show_map(request.run, view))

    def _show_map(self, run: str, view: MapView) -> None:
        if self._view is not None and self._view.run is not None and self._view.run.name == run:
            self._map_key = view.key
            self._side.show_map(view)

    def _filmed(self) -> tuple[str, int] | None:
        """Run and seed to film, once a ball was played."""
        view, details = self._view, self._details
        if view is None or view.run is None or details is None or not details.episodes_done:
            return None
        return view.run.name, details.seed

    def _tell_ends(self, view: RunsView) -> None:
        """Notify that a training has just ended."""
        for run in view.runs:
            was = self._phases.get(run.name)
            self._phases[run.name] = run.phase
            if was is None or was == run.phase or run.active:
                continue
            if run.phase == "failed":
                self._host.note(f"Training {run.name} failed", f"{run.message}; its log is on the left", "red")
            elif run.phase in ("finished", "stopped"):
                learned = learned_text(run.config, view.results.get(run.name, {}))
                text = f"It {learned}." if learned else "It was saved with its policies."
                self._host.note(f"Training {run.name} {run.phase}", text, "green")

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._fail(error))

    def _fail(self, error: Exception) -> None:
        self._waiting = False
        self._asked_s = time.monotonic() + AFTER_FAILURE_S  # no repeated notifications
        self._scene.clear()
        self._host.report(error)

    # Actions ---------------------------------------------------------------------------------------

    def train_now(self) -> None:
        """Start the preset that goes from misses to placed balls."""
        self._begin_preset(PRESETS[TRAIN_NOW])

    def train_curriculum(self) -> None:
        """Start the paper's agent on its two stages."""
        self._begin_preset(PRESETS[THE_CURRICULUM])

    def _begin_preset(self, preset: Preset) -> None:
        self._host.later(lambda: self._start("", preset.config, preset.slug, preset.pace))

    def _start_form(self, name: str, config: RunConfig, place: str) -> None:
        preset = self._form_panel.preset
        self._start(name, config, preset.slug if preset.config == config else config.agent, self._pace, place)

    def _start(self, name: str, config: RunConfig, stem: str, pace: str, place: str = THIS_MACHINE) -> None:
        """Start a run of that name, or, without one, of a free name made of `stem`."""
        with nullcontext(name) if name.strip() else self._trainer.free_name(stem) as chosen:
            self._begin(chosen, config, pace, place)

    def _choose_preset(self, preset: Preset) -> None:
        """Choose a preset and its speed; a running training keeps its own speed."""
        self._pace = preset.pace
        if self._trainer.active() is None:
            self._run_panel.show_pace(preset.pace)

    def _begin(self, name: str, config: RunConfig, pace: str, place: str = THIS_MACHINE) -> None:
        self._trainer.start(name, startable_run(config), PACES[pace], place)
        self._run_panel.show_pace(pace)
        self._follow(None)

    def ask(self, command: RunCommand) -> None:
        """Pause or continue."""
        self._host.later(lambda: self._trainer.ask(command))

    def ask_to_stop(self) -> None:
        """Stop after a confirmation."""
        self._host.later(self._confirm_stop)

    def _confirm_stop(self) -> None:
        active = self._trainer.active()
        if active is not None:
            confirm_stop(
                self._host.client.gui, active.name, lambda: self._host.later(lambda: self._trainer.ask("stop"))
            )

    def resume(self) -> None:
        """Resume the run that is shown."""
        self._host.later(self._resume)

    def _resume(self) -> None:
        if self._view is not None and self._view.run is not None:
            self._trainer.resume(self._view.run.name)
            self._asked_s = float("-inf")

    def let_play(self) -> None:
        """Let the policy of the run that is shown play the live rally; without one, the training's serves."""
        self._host.later(self._let_play)

    def _let_play(self) -> None:
        host, live = self._host, self._host.services.rallies.live
        if self._view is None or self._view.run is None:
            return
        if live is None or not live.has_robot:
            self._scene.let_policy_play()
            return
        name = self._view.run.name

        def work() -> None:
            try:
                let_play(live, host.services.workspace, name)
            except RallyscopeError as error:
                self._report(error)
            else:
                host.later(lambda: self._watch(name))

        host.pool.submit(work)

    def _watch(self, name: str) -> None:
        self._host.open_recording(LIVE)
        self._host.send(SetMode("Watch"))
        self._host.note(f"{name} plays", "Its policy plays the live rally; Watch counts the returns.", "green")

    def _report(self, error: RallyscopeError) -> None:
        self._host.later(lambda: self._host.report(error))

    def set_pace(self, pace: str) -> None:
        """Slow the training down, or let it run."""
        if pace in PACES:
            self._host.later(lambda: self._set_pace(pace))

    def _set_pace(self, pace: str) -> None:
        self._pace = pace
        self._trainer.set_pace(PACES[pace])

    def choose_run(self, name: str) -> None:
        """Show another run."""
        self._host.later(lambda: self._follow(None if name == NEWEST else name))

    def _follow(self, name: str | None) -> None:
        self._chosen = name
        self._run_panel.show_run(name)
        self._asked_s = float("-inf")

    def compare_with(self, name: str) -> None:
        """Choose other runs whose curves are drawn too."""
        compared = None if name == LAST_ONES else () if name == NOBODY else (name,)
        self._host.later(lambda: self._compare(compared))

    def _compare(self, compared: tuple[str, ...] | None) -> None:
        self._compared = compared
        self._asked_s = float("-inf")
