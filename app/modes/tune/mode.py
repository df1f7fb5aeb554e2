"""Tune: one window of one camera through the detector, stage by stage, and how good its settings are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from app.background.jobs import LatestWins, LoopJob, Progress
from app.modes.mode import Middle, ModeHost
from app.modes.tune.auto_tune import AutoTune
from app.modes.tune.compare import CompareOverTime
from app.modes.tune.compare_run import CompareAnswer, KnownReferences, check_whole
from app.modes.tune.label_score import LabelScore, labels_to_score, score_with_labels
from app.modes.tune.nothing_found import NothingFound, SampleRequest
from app.modes.tune.results_panel import KEPT, ResultsPanel
from app.modes.tune.run_score import RunScore, score_run
from app.modes.tune.settings import ConfigFilesPanel, SettingsPanel, TuneViewPanel, detect_command
from app.modes.tune.verdict_line import ScoredConfig, ShownWindow, VerdictLine
from app.panels.time_bar import Runs, runs_of_verdicts
from app.shared.workspace import taken_text
from app.state.client_state import SLOTS, ClientState, PickedPoint, Slot
from app.state.commands import BeginScore, Command, PickCluster, SetMode, UseConfig
from app.state.config_words import config_words
from app.views.answer_cache import AnswerCache
from app.views.frame_picture import titled_frames
from app.views.methods_picture import MethodsRequest, answer_methods
from app.views.requests import PictureAnswer, TuneRequest, answer_request
from app.views.stage_picture import miss_px
from core.detection import DetectorConfig
from core.detection.methods import METHODS, Method
from core.detection.saved import RIMLESS, load_detector
from core.metrics import judge_answers, known_truth
from core.recordings import Recording

PROGRESS_EVERY_S: Final = 0.1
OFFER_EVERY_S: Final = 2.0


class TuneMode:
    """The Tune mode of one browser."""

    uses_recording = True
    takes_keys = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self.scores: tuple[tuple[ScoredConfig, float], ...] = ()
        """The last scores of the open recording against its truth, newest first, with their recall."""
        self.window: ShownWindow | None = None
        """The window that is shown, of the config that the sliders change; None while methods are side by side."""
        self._active = False
        self._shown: ClientState | None = None
        self._requested: object = None
        self._progress_s = self._offered_s = float("-inf")
        self._score = LoopJob[RunScore | LabelScore](
            host.later, host.report, lambda: self._results.score.show_running(False)
        )
        self._verdicts = VerdictLine(lambda runs: host.show_runs("detector", runs))
        self._answers = AnswerCache()
        self._last_px: dict[str, tuple[float, float]] = {}
        """Last position of the ball, by camera."""
        self._known = KnownReferences()
        self._pictures = LatestWins(host.pool, _answer, self._picture_done, self._picture_failed)
        gui = host.client.gui
        self._view = TuneViewPanel(gui, self._send)
        self._settings = SettingsPanel(gui, self._send)
        self._compare = CompareOverTime(host, self._send, lambda: self._results.score.timing)
        self._results = ResultsPanel(
            gui, lambda: host.later(self._start_score), lambda: host.later(self._score.cancel),
            lambda: host.later(lambda: self._use_config(RIMLESS)),
        )  # fmt: skip
        self._nothing = NothingFound(host.pool, host.later, self._failed, self._results.candidates.show_nothing_found)
        self._sample: SampleRequest | None = None
        self._auto = AutoTune(host, self._results.show_tuned, lambda: self._results.score.timing)
        self._files = ConfigFilesPanel(
            gui,
            lambda name: host.later(lambda: self._save_config(name)),
            lambda name: host.later(lambda: self._load_config(name)),
        )
        self._now_us = 0
        self._show_folders(False)

    @property
    def middle(self) -> Middle:
        """Tune shows a picture of its own, or the window's events in space and time."""
        state = self._host.state
        return "space" if state is not None and state.tune.shows_space else "sheet"

    @property
    def comparison(self) -> CompareAnswer | None:
        """The last comparison over the open recording."""
        return self._compare.answer

    @property
    def needs_tick(self) -> bool:
        """Whether a score, a search or a comparison is running."""
        return self._score.running or self._auto.running or self._compare.running

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._active = active
        self._show_folders(active)
        self._results.panel.visible = active
        self._compare.show(active)
        self._known.clear()  # labels may have changed
        if not active:
            self._verdicts.follow(None)
        self._host.space.on_pick = (lambda point: self._host.later(lambda: self._pick(point))) if active else None
        self._shown = self._requested = None
        self._progress_s = self._offered_s = float("-inf")

    def use_recording(self, recording: Recording) -> None:
        """Cancel the work on the previous recording."""
        self._score.cancel()
        self._auto.cancel()
        self._compare.forget()
        self._verdicts.forget()
        self._answers.clear()
        self.scores, self.window = (), None
        self._sample = None
        self._last_px.clear()
        self._known.clear()

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Update the controls from the state, and request its picture."""
        # A live recording grows in every turn, which changes no control.
        if (shown := state.without_growth()) != self._shown:
            self._shown = shown
            with self._host.client.atomic():
                self._view.show(state)
                self._settings.show(state)
                self._auto.panel.use_method(state.tune.method)
                self._compare.show_state(state)
            self._verdicts.follow(shown_config(state))
        if wall_s - self._offered_s > OFFER_EVERY_S:
            self._offered_s = wall_s
            self._files.show(self._host.services.workspace.config_names())
        share = self._score.share
        if share is not None and wall_s - self._progress_s >= PROGRESS_EVERY_S:
            self._progress_s = wall_s
            self._results.score.show_progress(share)
        if state.score_by is not None:
            self._host.send(BeginScore())
            self._score.cancel()
            self._start_score(state.score_by)
        self._settings.tick(wall_s)
        self._auto.tick(wall_s)
        self._compare.tick(wall_s)
        self._nothing.want(self._sample, wall_s)
        self._nothing.tick(wall_s)
        self._request_picture(state, now_us, wall_s)

    def clicked(self, x: float, y: float) -> None:
        """Centre the zoomed view on the click; a cluster there moves to the top of the table."""
        if (point := self._host.plane.sheet.sensor_point(x, y)) is not None:
            self._pick(point)

    def _pick(self, point: tuple[float, float]) -> None:
        state = self._host.state
        if state is not None:
            self._host.send(PickCluster(PickedPoint(state.camera, self._now_us, point)))

    def close(self) -> None:
        """The browser has disconnected."""
        self._pictures.close()
        self._nothing.close()
        self._score.close()
        self._auto.close()
        self._compare.close()

    def _send(self, command: Command) -> None:
        """Apply a control's change; if it is refused, the control shows the old value again."""
        self._host.send(command)
        self._host.later(self._show_anew)

    def _show_folders(self, visible: bool) -> None:
        """Show the sections without a folder around them: each level of folders narrows the label column."""
        for panel in (self._view, self._compare.panel, self._settings, self._auto.panel, self._files):
            panel.folder.visible = visible
        self._view.space_folder.visible = visible

    def _show_anew(self) -> None:
        self._shown = None

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._host.report(error))

    # Pictures -----------------------------------------------------------------------------------------------------

    def _request_picture(self, state: ClientState, now_us: int, wall_s: float) -> None:
        recording, view = self._host.recording, state.tune
        self._now_us = now_us
        if recording is None:
            return
        slots: tuple[Slot, ...] = SLOTS if view.compare and not view.shows_space else (view.slot,)
        configs: tuple[tuple[Slot, DetectorConfig], ...] = tuple(
            (slot, state.history.present.of(slot)) for slot in slots
        )
        compared = tuple(state.config_of(method) for method in view.compared) if view.side_by_side else ()
        key = (recording.uuid, state.camera, now_us, state.look, view, configs, compared, self._host.plane.free_aspect)
        if key != self._requested:
            self._requested = key
            request = self._request(state, recording, now_us, configs)
            self._host.plane.freshness.ask(request, wall_s)
            self._pictures.submit(request)

    def _request(
        self, state: ClientState, recording: Recording, now_us: int, configs: tuple[tuple[Slot, DetectorConfig], ...]
    ) -> TuneRequest | MethodsRequest:
        stream, view = recording.cameras[state.camera], state.tune
        if not view.side_by_side:
            last_px = self._last_px.get(state.camera)
            aspect = self._host.plane.free_aspect
            frames = titled_frames(recording).get(view.frames)
            return TuneRequest(stream, now_us, state.look, view, configs, self._answers, last_px, aspect, frames)
        methods: tuple[tuple[Method, DetectorConfig], ...] = tuple(
            (method, state.config_of(method)) for method in view.compared
        )
        known, uuid, folder = self._known, recording.uuid, self._host.services.workspace.labels
        return MethodsRequest(
            stream, now_us, state.look, view, methods, self._answers, lambda: known.find(folder, uuid, stream)
        )

    def _picture_done(self, request: TuneRequest | MethodsRequest, answer: PictureAnswer) -> None:
        self._host.later(lambda: self._show_answer(request, answer))

    def _picture_failed(self, error: Exception) -> None:
        self._host.later(self._host.plane.freshness.failed)
        self._failed(error)

    def _show_answer(self, request: TuneRequest | MethodsRequest, answer: PictureAnswer) -> None:
        if not self._active:
            return
        if answer.space is None:
            self._host.plane.show(answer.sheet, request)
        else:
            self._host.plane.freshness.answered(request)
            self._host.space.show(answer.space)
            self._view.show_note(answer.space.note)
        if isinstance(request, TuneRequest):
            for found in answer.found[:1]:
                if found.detection is not None:
                    self._last_px[request.stream.name] = (found.detection.u_px, found.detection.v_px)
        self._sample = self._sample_for(request, answer)
        self.window = None
        names = tuple(name for name, _ in request.configs)
        with self._host.client.atomic():
            if (state := self._host.state) is not None:
                self._view.show_found(state, found=any(one.detection is not None for one in answer.found))
            if isinstance(request, TuneRequest):
                found, stream = answer.found[names.index(request.view.slot)], request.stream
                self.window = ShownWindow(stream.name, request.t_us, miss_px(found.detection, stream.truth))
                self._settings.show_trace(found.trace)
                picked, here = request.view.picked, (stream.name, request.t_us)
                picked_px = picked.point_px if picked and (picked.camera, picked.t_us) == here else None
                titled = zip((f"Config {name}" for name in names), answer.found, strict=True)
                self._results.candidates.show(tuple(titled), answer.seconds, picked_px, answer.misses_px)
            else:
                self._settings.show_trace(None)
                self._results.candidates.show_verdicts(tuple(zip(names, answer.found, strict=True)), answer.seconds)

    def _sample_for(self, request: TuneRequest | MethodsRequest, answer: PictureAnswer) -> SampleRequest | None:
        """What to sample of the recording after a window without a ball."""
        state, recording = self._host.state, self._host.recording
        if not isinstance(request, TuneRequest) or state is None or recording is None:
            return None
        if any(found.detection is not None for found in answer.found):
            return None
        stream, method = request.stream, request.view.method
        key = (recording.uuid, stream.name, method, state.config_of(method))
        configs: dict[Method, DetectorConfig] = {name: state.config_of(name) for name in METHODS}
        return SampleRequest(key, stream, method, configs, state.playhead.live)

    # Config files -------------------------------------------------------------------------------------------------

    def _save_config(self, name: str) -> None:
        state, workspace = self._host.state, self._host.services.workspace
        if state is not None:
            wanted, path = workspace.config_path(name).stem, workspace.keep_config(name, state.detector)
            self._files.show(workspace.config_names(), chosen=path.stem)
            text = f"{taken_text(wanted, path)}In a terminal: {detect_command(state.tune.method, path)}"
            self._host.note(f"Saved as {path.stem}", text, "green")

    def _load_config(self, name: str) -> None:
        workspace = self._host.services.workspace
        if name in workspace.config_names():
            self._use_config(workspace.config_path(name))

    def _use_config(self, path: Path) -> None:
        saved = load_detector(path)
        self._send(UseConfig(saved.config, saved.method))

    # The score ----------------------------------------------------------------------------------------------------

    def _start_score(self, annotator: str | None = None) -> None:
        """Start a score against the labels of one annotator, or what `labels_to_score` takes, then show the result."""
        state, recording = self._host.state, self._host.recording
        if state is None or recording is None or self._score.running:
            return
        stream, config = recording.cameras[state.camera], state.config
        method, timing = state.tune.method, self._results.score.timing
        scored = shown_config(state)
        early = f", windows end {timing.ends.words}" if timing.ends.words else ""
        title = f"{state.recording}, {state.camera}, {config_words(method, state.tune.slot, config)}{early}"
        folder, uuid, later = self._host.services.workspace.labels, recording.uuid, self._host.later

        def work(progress: Progress, cancelled: Callable[[], bool]) -> RunScore | LabelScore:
            reference = labels_to_score(folder, uuid, stream, annotator)
            if reference is None:
                truth = known_truth(stream)
                score = score_run(
                    stream, truth, method, config, ends=timing.ends, progress=progress, cancelled=cancelled
                )
                runs = runs_of_verdicts(judge_answers(score.timed.answers, truth), score.judged.run.window_us)
                later(lambda: self._show_verdicts(uuid, scored, runs))
                return score
            check_whole(timing.ends)
            return score_with_labels(
                *(folder, reference, stream, method, config, timing.added_us), progress=progress, cancelled=cancelled
            )

        self._score.start(work, lambda score: self._score_done(title, scored, score, announced=annotator is not None))
        self._results.score.show_running(True, title)

    def _show_verdicts(self, uuid: str, scored: ScoredConfig, runs: Runs) -> None:
        """Mark in the time bar where the score counted hits, misses and false positives; a click goes there."""
        recording, state = self._host.recording, self._host.state
        if self._score.running and recording is not None and recording.uuid == uuid:
            self._verdicts.keep(scored, runs)
            self._verdicts.follow(shown_config(state) if self._active and state is not None else None)

    def _score_done(self, title: str, scored: ScoredConfig, score: RunScore | LabelScore, *, announced: bool) -> None:
        if isinstance(score, RunScore):
            self.scores = ((scored, score.judged.recall), *self.scores)[:KEPT]
        self._results.score.show_score(title, score)
        if announced and self._active:
            self._results.score.show_window(lambda: self._host.send(SetMode("Label")))


def shown_config(state: ClientState) -> ScoredConfig:
    """What a score that is started now is of."""
    return ScoredConfig(state.camera, state.tune.method, state.config)


def _answer(request: TuneRequest | MethodsRequest) -> PictureAnswer:
    """Handle the pictures of either request."""
    return answer_methods(request) if isinstance(request, MethodsRequest) else answer_request(request)
