"""How far the clicked corners are, in plain words, as HTML; and what a request for poses answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.formatting.file_text import html_text
from app.modes.watch.figures import figures_html, muted
from app.state.table_clicks import CORNER_NAMES, TableClicks
from core.cameras import Camera
from core.cameras.calibration.table_corners import CLICKS_AT_LEAST
from core.cameras.calibration.table_pose import TablePose, clicks_of, find_table_pose
from core.errors import CalibrationError


@dataclass(frozen=True, slots=True, eq=False)
class PosesRequest:
    """Clicks, and the lenses of all cameras; None: not known."""

    lenses: Mapping[str, Camera | None]
    clicks: TableClicks


Poses = dict[str, TablePose | str]
"""By camera; text: why there is none yet."""


def find_poses(request: PosesRequest) -> Poses:
    """Each camera's pose, as far as the clicks go."""
    found: Poses = {}
    for name, lens in request.lenses.items():
        marks = request.clicks.of(name)
        if lens is None:
            found[name] = "its lens is not known: give a calibration of it with --calibration"
        elif len(marks) < CLICKS_AT_LEAST:
            found[name] = f"{len(marks)} of {CLICKS_AT_LEAST} corners or more"
        else:
            try:
                found[name] = find_table_pose(name, lens, clicks_of(marks))
            except CalibrationError as error:
                found[name] = str(error)
    return found


def poses_html(poses: Poses) -> str:
    """A row a camera."""
    return figures_html([(html_text(name), _pose(pose)) for name, pose in poses.items()])


def corner_option(corner: str) -> str:
    """A corner with its number, as the list of them shows it."""
    return f"{CORNER_NAMES.index(corner) + 1} {corner}"


def _pose(pose: TablePose | str) -> str:
    if isinstance(pose, str):
        return muted(html_text(pose))
    worst = max(range(len(pose.names)), key=lambda row: pose.errors_px[row])
    where = ", ".join(f"{value:+.2f}" for value in pose.camera.position_world_m)
    said = f"{pose.rms_px:.1f} px off, most {pose.names[worst]} ({pose.errors_px[worst]:.1f} px)"
    return f"{said}; stands at {where} m, &plusmn;{1e3 * pose.sigma_m:.0f} mm"
