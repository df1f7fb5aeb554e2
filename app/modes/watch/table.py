"""Camera poses from clicks on the table's corners in the cameras' pictures."""

from __future__ import annotations

import math
import time
import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace

import viser

from app.background.jobs import LatestWins
from app.formatting import html_text
from app.modes.mode import ModeHost
from app.modes.watch.figures import figures_html, muted
from app.shared.live_rally import LiveRally
from app.state.client_state import ClientState
from app.state.swept_cells import CORNER_NAMES, TableClicks
from app.widgets import when_changed, when_clicked
from core.cameras import Camera
from core.cameras.calibration.table_corners import CLICKS_AT_LEAST
from core.cameras.calibration.table_pose import (
    TablePose,
    clicks_of,
    find_table_pose,
    place_at_table,
    write_table_calibration,
)
from core.errors import CalibrationError, CommandError, RallyscopeError
from core.recordings import Recording


@dataclass(frozen=True, slots=True)
class LetTableBeClicked:
    """Set whether clicks on a picture mark corners."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, replace(state.watch.table, active=bool(self.on)))


@dataclass(frozen=True, slots=True)
class ChooseTableCorner:
    """Choose the corner that the next click marks."""

    corner: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.corner not in CORNER_NAMES:
            return state
        return _with(state, replace(state.watch.table, corner=self.corner))


@dataclass(frozen=True, slots=True)
class ClickTableCorner:
    """Mark the chosen corner in a camera's picture."""

    camera: str
    u_px: float
    v_px: float

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        table = state.watch.table
        known = self.camera in state.cameras and math.isfinite(self.u_px) and math.isfinite(self.v_px)
        if not (table.active and known):
            return state
        return _with(state, table.clicked(self.camera, self.u_px, self.v_px))


@dataclass(frozen=True, slots=True)
class UndoTableCorner:
    """Undo the last click."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, state.watch.table.undone())


@dataclass(frozen=True, slots=True)
class ForgetTableCorners:
    """Remove all clicks."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, TableClicks(active=state.watch.table.active))


def _with(state: ClientState, table: TableClicks) -> ClientState:
    return replace(state, watch=replace(state.watch, table=table))


@dataclass(frozen=True, slots=True, eq=False)
class PosesRequest:
    """Clicks and the lens of each camera; None: unknown lens."""

    lenses: Mapping[str, Camera | None]
    clicks: TableClicks


Poses = dict[str, TablePose | str]
"""Pose by camera, or the reason why there is none yet."""


def find_poses(request: PosesRequest) -> Poses:
    """Pose of each camera, where there are enough clicks."""
    found: Poses = {}
    for name, lens in request.lenses.items():
        marks = request.clicks.of(name)
        if lens is None:
            found[name] = "unknown lens: give its calibration with --calibration"
        elif len(marks) < CLICKS_AT_LEAST:
            found[name] = f"{len(marks)} of {CLICKS_AT_LEAST} corners or more"
        else:
            try:
                found[name] = find_table_pose(name, lens, clicks_of(marks))
            except CalibrationError as error:
                found[name] = str(error)
    return found


def poses_html(poses: Poses) -> str:
    """HTML with a row per camera."""
    return figures_html([(html_text(name), _pose(pose)) for name, pose in poses.items()])


def corner_option(corner: str) -> str:
    """Text of a corner with its number, for the list."""
    return f"{CORNER_NAMES.index(corner) + 1} {corner}"


def _pose(pose: TablePose | str) -> str:
    if isinstance(pose, str):
        return muted(html_text(pose))
    worst = max(range(len(pose.names)), key=lambda row: pose.errors_px[row])
    where = ", ".join(f"{value:+.2f}" for value in pose.camera.position_world_m)
    html = f"{pose.rms_px:.1f} px off, most {pose.names[worst]} ({pose.errors_px[worst]:.1f} px)"
    return f"{html}; stands at {where} m, &plusmn;{1e3 * pose.sigma_m:.0f} mm"


class TablePanel:
    """Table corners clicked in one browser. Poses are computed and written in the thread pool."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._shown: tuple[Recording | None, TableClicks] | None = None
        self._poses = LatestWins(host.pool, find_poses, self._found, self._failed)
        self._live: LiveRally | None = None
        self._folder = gui.add_folder("Table", expand_by_default=False, visible=False)
        with self._folder:
            hint = "Clicks on the cameras' pictures then mark corners of the table"
            self._active = gui.add_checkbox("Click the corners", False, hint=hint)
            hint = "Left and right as the robot sees them; the next one is chosen automatically"
            self._corner = typing.cast(
                "viser.GuiDropdownHandle[str]",
                gui.add_dropdown("Next corner", tuple(map(corner_option, CORNER_NAMES)), hint=hint),
            )
            self._status = gui.add_html("")
            self._undo = gui.add_button("Undo the click", icon=viser.Icon.ARROW_BACK_UP)
            self._forget = gui.add_button("Remove all clicks", icon=viser.Icon.ERASER)
            hint = "Saved as a new calibration; a live source uses it at once"
            self._use = gui.add_button("Use these poses", icon=viser.Icon.CHECK, color="teal", hint=hint)
        when_changed(self._active, lambda on: host.send(LetTableBeClicked(bool(on))))
        when_changed(self._corner, lambda html: host.send(ChooseTableCorner(str(html).partition(" ")[2])))
        when_clicked(self._undo, lambda: host.send(UndoTableCorner()))
        when_clicked(self._forget, lambda: host.send(ForgetTableCorners()))
        when_clicked(self._use, lambda: host.later(self._ask))

    def show(self, state: ClientState, live: LiveRally | None, *, flat: bool) -> None:
        """Update from the state; visible only with the cameras' pictures."""
        self._folder.visible = flat
        recording, clicks = self._host.recording, state.watch.table
        self._live = live
        if not flat or (recording, clicks) == self._shown or recording is None:
            return
        self._shown = recording, clicks
        self._active.value, self._corner.value = clicks.active, corner_option(clicks.corner)
        self._undo.disabled = self._forget.disabled = not clicks.marks
        self._poses.submit(_request(recording, clicks))

    def clicked(self, x: float, y: float) -> None:
        """Handle a click, in pixels of the mosaic."""
        state = self._host.state
        if state is None or not state.watch.table.active:
            return
        large = state.watch.large
        names = (large,) if large in state.cameras else state.cameras
        for name, picture in zip(names, self._host.plane.sheet.pictures, strict=False):
            at = picture.sensor_point(x, y)
            if at is not None:
                self._host.send(ClickTableCorner(name, *at))

    def close(self) -> None:
        """The browser has disconnected."""
        self._poses.close()

    def _found(self, request: PosesRequest, poses: Poses) -> None:
        self._host.later(lambda: self._say(poses_html(poses)))

    def _say(self, html: str) -> None:
        self._status.content = html

    def _ask(self) -> None:
        """Start the computation for the current clicks; called in the loop."""
        recording, state = self._host.recording, self._host.state
        if recording is not None and state is not None:
            request, live = _request(recording, state.watch.table), self._live
            self._host.pool.submit(lambda: self._write(request, live))

    def _write(self, request: PosesRequest, live: LiveRally | None) -> None:
        try:
            if live is not None and live.recorded is not None:
                remedy = "stop it first: a recording keeps the poses it was started with"
                raise CommandError("a recording is being written", where=live.recorded, remedy=remedy)
            clicks = {name: clicks_of(request.clicks.of(name)) for name in request.lenses}
            poses = place_at_table(request.lenses, clicks)
            folder = self._host.services.workspace.cameras
            files = write_table_calibration(folder, time.strftime("table-%Y%m%d-%H%M%S"), poses, clicks)
            used = live is not None and live.recalibrate({name: pose.camera for name, pose in poses.items()})
        except (RallyscopeError, OSError) as error:
            self._failed(error)
            return
        then = "Used from now on. Next time: --calibration" if used else "For import or serve: --calibration"
        self._host.later(lambda: self._host.note("Calibration written", f"{then} {files.calibration}", "green"))

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._host.report(error))


def _request(recording: Recording, clicks: TableClicks) -> PosesRequest:
    return PosesRequest({name: stream.calibration for name, stream in recording.cameras.items()}, clicks)
