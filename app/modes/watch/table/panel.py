"""Clicking the table's corners in the flat pictures: which one is next, how well they fit, and the poses' use."""

from __future__ import annotations

import time
import typing

import viser

from app.background.worker import LatestWins
from app.modes.mode import ModeHost
from app.modes.watch.table.commands import (
    ChooseTableCorner,
    ClickTableCorner,
    ForgetTableCorners,
    LetTableBeClicked,
    UndoTableCorner,
)
from app.modes.watch.table.words import Poses, PosesRequest, corner_option, find_poses, poses_html
from app.shared.live_rally import LiveRally
from app.state.client_state import ClientState
from app.state.table_clicks import CORNER_NAMES, TableClicks
from app.widgets import when_changed, when_clicked
from core.cameras.calibration.table_calibration import place_at_table, write_table_calibration
from core.cameras.calibration.table_pose import clicks_of
from core.errors import CommandError, RallyscopeError
from core.recordings import Recording


class TablePanel:
    """Table corners clicked in one browser. Poses are computed and written in the pool."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._shown: tuple[Recording | None, TableClicks] | None = None
        self._poses = LatestWins(host.pool, find_poses, self._found, self._failed)
        self._live: LiveRally | None = None
        self._folder = gui.add_folder("Table", expand_by_default=False, visible=False)
        with self._folder:
            hint = "Each click on a picture is then a point of the table, in every camera's picture"
            self._active = gui.add_checkbox("Click its corners", False, hint=hint)
            hint = "Left and right as the robot sees them; the next one is chosen by itself"
            self._corner = typing.cast(
                "viser.GuiDropdownHandle[str]",
                gui.add_dropdown("Next corner", tuple(map(corner_option, CORNER_NAMES)), hint=hint),
            )
            self._said = gui.add_html("")
            self._undo = gui.add_button("Undo the click", icon=viser.Icon.ARROW_BACK_UP)
            self._forget = gui.add_button("Forget all clicks", icon=viser.Icon.ERASER)
            hint = "Written as a new calibration; a live source goes on with it"
            self._use = gui.add_button("Use these poses", icon=viser.Icon.CHECK, hint=hint)
        when_changed(self._active, lambda on: host.send(LetTableBeClicked(bool(on))))
        when_changed(self._corner, lambda said: host.send(ChooseTableCorner(str(said).partition(" ")[2])))
        when_clicked(self._undo, lambda: host.send(UndoTableCorner()))
        when_clicked(self._forget, lambda: host.send(ForgetTableCorners()))
        when_clicked(self._use, lambda: host.later(self._ask))

    def show(self, state: ClientState, live: LiveRally | None, *, flat: bool) -> None:
        """Follow the state; only where the flat pictures are."""
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
        """On the sheet, in sheet pixels."""
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
        """The browser is gone."""
        self._poses.close()

    def _found(self, request: PosesRequest, poses: Poses) -> None:
        self._host.later(lambda: self._say(poses_html(poses)))

    def _say(self, said: str) -> None:
        self._said.content = said

    def _ask(self) -> None:
        """In the loop: what is clicked now counts."""
        recording, state = self._host.recording, self._host.state
        if recording is not None and state is not None:
            request, live = _request(recording, state.watch.table), self._live
            self._host.pool.submit(lambda: self._write(request, live))

    def _write(self, request: PosesRequest, live: LiveRally | None) -> None:
        try:
            if live is not None and live.recorded is not None:
                remedy = "stop it first: its cameras stand where they stood when it was begun"
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
