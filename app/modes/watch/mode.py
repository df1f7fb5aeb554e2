"""Watch: the rally in 3D with the cameras' pictures beside it, live or recorded; or the pictures alone, large."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from app.background.jobs import LatestWins
from app.modes.mode import Middle, ModeHost, do_in_pool
from app.modes.watch.balls_panel import BallsPanel
from app.modes.watch.cameras_panel import CamerasPanel, sighting_of
from app.modes.watch.commands import EnlargeCamera, SetPrediction
from app.modes.watch.learning import LearningPanel
from app.modes.watch.missed_ball import MissedBallSearch
from app.modes.watch.robot import RobotPanel
from app.modes.watch.simulation_panel import SimulationPanel
from app.modes.watch.source_panel import SourcePanel
from app.modes.watch.status import live_html, moment_html
from app.modes.watch.sweep import BoardPanel, SweepPanel
from app.modes.watch.table import TablePanel
from app.modes.watch.view_panel import ViewPanel
from app.scene.view_camera import render_view
from app.scene.world import LAYERS
from app.shared.live_rally import LiveRally, positions
from app.shared.rallies import WatchedRally
from app.state.client_state import ClientState
from app.views.camera_pictures import (
    CameraPicturesRequest,
    FrameSighting,
    LargeFrameRequest,
    frame_sightings,
    render_large_frame,
    with_frames,
)
from app.views.freshness import AnswerFreshness, Staleness
from app.views.mosaic import Mosaic
from core.chain.config import PREDICTIONS, PredictionName
from core.errors import CommandError
from core.history.lead_time import LeadTimeErrors, LeadTimesRequest, compute_lead_times
from core.history.rally_history import RallyMoment
from core.physics import TaskConfig
from core.recordings import Recording

DRAW_EVERY_S = 1 / 120
"""Shorter than the loop's period, so that every change is drawn."""
PICTURES_EVERY_S = 1 / 15
STATUS_EVERY_S = 0.15
THROTTLED_S = 0.5
"""Interval of pictures and figures on a throttled page; both at once, so that the panel is drawn once."""
CONTROLLERS_EVERY_S = 2.0
LEAD_TIMES_EVERY_S = 2.0
OLDEST_US = 2_000
"""An older circle is not drawn over a camera's events: it is where the ball was. The length of the chain's windows."""
PICTURE_PX = (1280, 720)
ACTION_LIMIT_DEG = TaskConfig().stroke.action_limit_deg


class WatchMode:
    """The Watch mode of one browser."""

    uses_recording = True
    takes_keys = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._rally: WatchedRally | None = None
        self._live: LiveRally | None = None
        """Live rally of the open recording; None for a file."""
        self._prediction: PredictionName = host.services.rallies.prediction
        """Prediction with which the shown recording is followed."""
        self._positions: dict[str, NDArray[np.float64]] = {}
        self._active = False
        gui = host.client.gui
        self._folder = gui.add_folder(None, visible=False)
        with self._folder:
            self._view = ViewPanel(
                gui,
                host.send,
                self._look_from,
                self._look_again,
                self._save_picture,
                host.world.views,
                self._predict,
            )
            self._table = TablePanel(gui, host)
            self._board = BoardPanel(gui, host)
            self._sweep = SweepPanel(gui, host)
            self._balls = BallsPanel(gui, host)
            self._missed = MissedBallSearch(host)
            self._simulation: SimulationPanel | None = None
            self._source: SourcePanel | None = None
            self._robot: RobotPanel | None = None
            self._learning: LearningPanel | None = None
        self._cameras = CamerasPanel(gui, lambda camera: host.send(EnlargeCamera(camera)))
        self._pictures = LatestWins(
            host.pool, host.services.camera_pictures, self._pictures_done, self._pictures_failed
        )
        self._large = LatestWins(host.pool, render_large_frame, self._large_done, self._large_failed)
        self._large_asked: object = None
        """Key of the frame that was asked for last to be shown full size."""
        self._freshness = AnswerFreshness()
        """Whether the cameras' pictures beside the 3D view are the answer to the latest request."""
        self._staleness: Staleness = ""
        self._lead_times = LatestWins(host.pool, compute_lead_times, self._show_lead_times, self._failed)
        self._drawn: object = None
        self._drawn_s = self._pictures_s = self._status_s = self._lead_times_s = 0.0
        self._controllers_s = self._simulation_s = 0.0
        self._predictions = -1

    @property
    def middle(self) -> Middle:
        """3D for a stereo recording, unless pictures are selected."""
        state = self._host.state
        if state is None or not self._has_panel:
            return "events"
        return "sheet" if state.watch.large in state.frame_cameras else "events" if state.watch.large else "world"

    @property
    def _has_panel(self) -> bool:
        """Whether the cameras' pictures stand beside what the middle shows."""
        state = self._host.state
        return self._rally is not None and state is not None and state.watch.in_space

    @property
    def needs_tick(self) -> bool:
        """Whether the rally is live, or the cameras' pictures are awaited: outdated ones are marked in time."""
        return self._live is not None or self._freshness.is_waiting

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._active = active
        self._folder.visible = active
        self._cameras.panel.visible = active and self._has_panel
        self._drawn = self._large_asked = None
        self._freshness.forget()
        self._show_staleness("")

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened."""
        self._missed.use_recording(recording)
        self._prediction = self._chosen_prediction(self._host.state)
        self._rally = self._host.services.rallies.of(recording, self._prediction)
        self._drawn = None
        self._status_s, self._predictions = 0.0, -1
        live = self._host.services.rallies.live
        self._live = live if live is not None and recording is live.recording else None
        if self._live is not None and self._simulation is None and self._source is None:
            self._add_controls(self._live)
        if self._rally is not None:
            self._positions = positions(self._rally.cameras)
            self._host.world.use_cameras(self._rally.cameras)

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Draw what changed since the last turn."""
        self._cameras.panel.visible = self._has_panel
        self._cameras.show_large(state.watch.large)
        if self.middle == "world":
            self._cameras.room.follow(self._host.client.camera.aspect)
        live = self._live
        self._follow_prediction(state)
        self._view.show(
            state,
            is_stereo=self._rally is not None,
            knows_ball=self._host.knows_ball,
            views=self._host.world.views,
            prediction=self._prediction if live is None else live.prediction,
        )
        self._table.show(state, live, flat=self.middle == "events")
        self._board.show(state, now_us, wall_s, flat=self.middle == "events")
        self._sweep.show(state, flat=self.middle == "events")
        self._balls.tick(wall_s)
        self._missed.tick(None if self._rally is None else self._rally.history, now_us, wall_s)
        self._show_controls(live, wall_s)
        self._show_staleness(self._freshness.staleness(wall_s, moving=state.playhead.playing))
        if self._rally is None or not self._has_panel or wall_s - self._drawn_s < DRAW_EVERY_S:
            return
        self._request_lead_times(wall_s)
        history = self._rally.history
        if state.playhead.following:
            now_us = min(now_us, history.followed_us)
        followed = history.followed_us >= now_us, self._rally.has_reached(now_us)
        key = (now_us, state.watch, state.look, followed, history.outcome_count)
        status_every_s = THROTTLED_S if self._host.is_throttled else STATUS_EVERY_S
        status_is_due = wall_s - self._status_s >= status_every_s  # also while the clock stands: the link may be lost
        if key == self._drawn and not status_is_due:
            return
        moment = history.at(now_us, self._positions)
        of_frames = frame_sightings(history, self._rally.frames, now_us)
        if moment.step is not None:
            moment = replace(moment, step=with_frames(moment.step, of_frames))
        if status_is_due:
            self._status_s = wall_s
            self._show_status(moment)
        if key == self._drawn:
            return
        self._drawn, self._drawn_s = key, wall_s
        self._host.world.layers = frozenset(LAYERS) - state.watch.hidden
        if self.middle == "world":
            self._host.world.draw(self._rally.picture_of(moment))
        asked = self._pictures_at(state, moment, of_frames)
        self._request_large(state, asked, wall_s)
        self._request_pictures(state, asked, wall_s)

    def _chosen_prediction(self, state: ClientState | None) -> PredictionName:
        chosen = None if state is None else state.watch.prediction
        return chosen or self._host.services.rallies.prediction

    def _follow_prediction(self, state: ClientState) -> None:
        """Show the recording with the chosen prediction: another pass of the chain, which begins now if need be."""
        recording = self._host.recording
        if self._live is None and recording is not None and self._chosen_prediction(state) != self._prediction:
            self.use_recording(recording)

    def _predict(self, name: str) -> None:
        """Use another prediction: in this browser for a recording, for all browsers in the live rally."""
        live = self._live
        if name not in PREDICTIONS:
            return
        if live is None:
            self._host.send(SetPrediction(name))
        else:
            do_in_pool(self._host, lambda: live.predict_with(name))

    def _show_controls(self, live: LiveRally | None, wall_s: float) -> None:
        """Show the live controls while a live rally is watched."""
        for panel in (self._simulation, self._source, self._learning, self._robot):
            if panel is not None:
                panel.set_visible(live is not None)
        if live is None:
            return
        if self._simulation is not None and wall_s - self._controllers_s > CONTROLLERS_EVERY_S:
            self._controllers_s = wall_s
            self._simulation.show_controllers()
        if self._simulation is not None and live.state is not None and wall_s - self._simulation_s >= STATUS_EVERY_S:
            self._simulation_s = wall_s
            self._simulation.show(live.state)
        for panel in (self._source, self._learning, self._robot):
            if panel is not None:
                panel.show(wall_s)

    def clicked(self, x: float, y: float) -> None:
        """Handle a click: it selects a corner of the table."""
        if self.middle == "events":
            self._table.clicked(x, y)

    def close(self) -> None:
        """The browser has disconnected."""
        self._missed.close()
        self._table.close()
        self._board.close()
        self._balls.close()
        self._pictures.close()
        self._large.close()
        self._lead_times.close()

    def _pictures_at(
        self, state: ClientState, moment: RallyMoment, of_frames: Mapping[str, FrameSighting]
    ) -> CameraPicturesRequest:
        recording, rally = self._host.recording, self._rally
        assert recording is not None and rally is not None
        shown_us = min(state.look.window_us, OLDEST_US)  # a circle belongs to the events that are drawn
        step = None if moment.step is None or moment.step.t_us < moment.t_us - shown_us else moment.step
        circles = {} if step is None else step.circles
        used = frozenset() if step is None else step.used
        with_truth = "True ball" not in state.watch.hidden
        numbers = tuple((name, one.number) for name, one in of_frames.items())
        reached = rally.has_reached(moment.t_us)
        return CameraPicturesRequest(recording, moment.t_us, state.look, circles, with_truth, used, numbers, reached)

    def _request_pictures(self, state: ClientState, request: CameraPicturesRequest, wall_s: float) -> None:
        every_s = THROTTLED_S if self._host.is_throttled else PICTURES_EVERY_S
        if state.playhead.playing and wall_s - self._pictures_s < every_s:
            return
        self._pictures_s = wall_s
        self._freshness.ask(request, wall_s)
        self._pictures.submit(request)

    def _pictures_done(self, request: CameraPicturesRequest, pngs: dict[str, bytes]) -> None:
        self._host.later(lambda: self._show_pictures(request, pngs))

    def _show_pictures(self, request: CameraPicturesRequest, pngs: dict[str, bytes]) -> None:
        if self._active and self._has_panel:
            self._freshness.answered(request)
            self._cameras.show(pngs, {name: sighting_of(request, name) for name in pngs})

    def _request_large(self, state: ClientState, pictures: CameraPicturesRequest, wall_s: float) -> None:
        """Ask for a frame camera's picture full size, if it is to be shown and is not the one that was asked for."""
        request = LargeFrameRequest(state.watch.large, pictures) if self.middle == "sheet" else None
        key = None if request is None else request.key
        if request is not None and key != self._large_asked:
            self._host.plane.freshness.ask(request, wall_s)
            self._large.submit(request)
        self._large_asked = key

    def _large_done(self, request: LargeFrameRequest, sheet: Mosaic) -> None:
        def show() -> None:
            if self._active and self.middle == "sheet":
                self._host.plane.show(sheet, request)

        self._host.later(show)

    def _large_failed(self, error: Exception) -> None:
        self._host.later(self._host.plane.freshness.failed)
        self._failed(error)

    def _pictures_failed(self, error: Exception) -> None:
        self._host.later(self._freshness.failed)
        self._failed(error)

    def _show_staleness(self, staleness: Staleness) -> None:
        """Mark the cameras' pictures on the page while they are outdated."""
        if staleness != self._staleness:
            self._staleness = staleness
            self._host.plane.tell("stale", {"docked": staleness})

    def _add_controls(self, live: LiveRally) -> None:
        gui = self._host.client.gui
        with self._folder:
            if live.robot is not None and live.step_test is not None:
                self._robot = RobotPanel(gui, live.robot, live.step_test, self._host)
            if live.simulation is not None:
                self._simulation = SimulationPanel(gui, live, live.simulation, self._host)
            else:
                self._source = SourcePanel(gui, live, self._host)
            self._learning = LearningPanel(gui, live, self._host)

    def _show_status(self, moment: RallyMoment) -> None:
        figures, live = "", self._live
        if live is not None and live.state is not None and self._simulation is not None:
            cameras = live.watch.health().cameras
            snapshot = live.player.snapshot
            figures = live_html(snapshot, live.state, live.source.status, cameras)
        assert self._rally is not None
        robot, outcomes = (True, True) if live is None else (live.has_robot, live.source.has_outcomes)
        status_html = moment_html(
            moment,
            ACTION_LIMIT_DEG,
            self._rally.followed,
            robot=robot,
            outcomes=outcomes,
            returned=self._live is None,
            drift=self._rally.drift,
            cameras=tuple(self._rally.cameras),
            reached=self._rally.has_reached(moment.t_us),
        )
        self._cameras.show_figures(status_html, figures)

    def _request_lead_times(self, wall_s: float) -> None:
        recording, rally = self._host.recording, self._rally
        if recording is None or rally is None or wall_s - self._lead_times_s < LEAD_TIMES_EVERY_S:
            return
        self._lead_times_s = wall_s
        predicted = rally.history.predicted_hits()
        if len(predicted) != self._predictions:
            self._predictions = len(predicted)
            self._lead_times.submit((recording, predicted))

    def _show_lead_times(self, request: LeadTimesRequest, errors: LeadTimeErrors | None) -> None:
        if errors is not None:
            self._host.later(lambda: self._cameras.show_lead_times(errors))

    def _look_from(self, view: str) -> None:
        self._host.later(lambda: self._host.world.look_from(view))

    def _look_again(self) -> None:
        self._host.later(lambda: self._host.world.look_from(self._host.world.view) if self._active else None)

    def _save_picture(self) -> None:
        """Save the view: the browser renders it again at the export size and downloads it."""
        client, eye = self._host.client, self._host.world.eye

        def save() -> None:
            try:
                pixels = render_view(client, *PICTURE_PX, eye)
            except CommandError as error:
                self._failed(error)
                return
            done, png = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
            if done:
                client.send_file_download("rallyscope.png", png.tobytes(), save_immediately=True)

        self._host.pool.submit(save)

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._host.report(error))
