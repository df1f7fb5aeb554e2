"""Static Rerun entities: table, net, hitting plane, cameras."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr

from app.export.rrd.camera_picture import EVENT_STAGE_NAMES, EventStage
from app.export.rrd.paths import HALF_PIXEL, RACKET_TARGET, WORLD, picture_path, send, time_column
from core.cameras import Camera
from core.geometry import quaternion_from_matrix, xyzw_from_wxyz
from core.table import (
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

TABLE_RGB = (24, 74, 140)
LINE_RGB = (235, 235, 235)
NET_RGB = (190, 195, 205)
LEG_RGB = (40, 42, 48)
PLANE_RGB = (120, 170, 255)
FATE_RGB = {
    EventStage.DENOISED: (120, 122, 130),
    EventStage.REJECTED: (190, 110, 110),
    EventStage.TRAILING: (110, 235, 130),
    EventStage.LEADING: (255, 225, 60),
}
RACKET_RGB = (200, 24, 30)
RACKET_TARGET_RGB = (60, 220, 120)
BLADE_RADIUS_M = 0.08
BLADE_M = 0.012
PLANE_WIDTH_M = 1.6
PLANE_HEIGHT_M = 0.7
THICKNESS_M = 0.025
LEG_M = 0.05


def log_arena(stream: rr.RecordingStream, hit_x_m: float | None) -> None:
    """Log table, net, and the hitting plane if there is one."""
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    leg = TABLE_HEIGHT_M - THICKNESS_M
    centres = [(0.0, 0.0, -THICKNESS_M / 2)]
    halves = [(TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2, THICKNESS_M / 2)]
    for x in (-1.1, 1.1):
        for y in (-0.6, 0.6):
            centres.append((x, y, -THICKNESS_M - leg / 2))
            halves.append((LEG_M / 2, LEG_M / 2, leg / 2))
    colours = [TABLE_RGB, *[LEG_RGB] * 4]
    table = rr.Boxes3D(centers=centres, half_sizes=halves, colors=colours, fill_mode="solid")
    stream.log(f"{WORLD}/table", table, static=True)
    stream.log(f"{WORLD}/table/lines", _lines(), static=True)
    stream.log(f"{WORLD}/net", _net(), static=True)
    if hit_x_m is None:
        return
    y, z = PLANE_WIDTH_M / 2, PLANE_HEIGHT_M
    corners = [(hit_x_m, -y, 0), (hit_x_m, y, 0), (hit_x_m, y, z), (hit_x_m, -y, z), (hit_x_m, -y, 0)]
    plane = rr.LineStrips3D([corners], colors=PLANE_RGB, radii=0.003)
    stream.log(f"{WORLD}/hitting_plane", plane, static=True)


def send_racket_shape(stream: rr.RecordingStream, path: str, first_us: int) -> None:
    """The shape of a racket whose pose is at `path`, from its first pose on; before it would stand at the origin.

    The face's normal is +x, the handle hangs down.
    """
    ghost = path == RACKET_TARGET
    colour = RACKET_TARGET_RGB if ghost else RACKET_RGB
    mode = rr.components.FillMode.MajorWireframe if ghost else rr.components.FillMode.Solid
    to_x = xyzw_from_wxyz(quaternion_from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])))
    blade = rr.Cylinders3D.columns(
        lengths=[BLADE_M], radii=[BLADE_RADIUS_M], centers=[(-BLADE_M / 2, 0, 0)], quaternions=[to_x],
        colors=[colour], fill_mode=[mode],
    )  # fmt: skip
    handle = rr.Boxes3D.columns(
        centers=[(-BLADE_M / 2, 0, -0.13)], half_sizes=[(0.011, 0.014, 0.055)], colors=[colour], fill_mode=[mode]
    )
    send(stream, f"{path}/blade", time_column([first_us]), blade)
    send(stream, f"{path}/handle", time_column([first_us]), handle)


def log_cameras(stream: rr.RecordingStream, cameras: Mapping[str, Camera | None]) -> None:
    """Poses and pinholes. Rerun knows no lens distortion: the pictures are the raw ones."""
    colours = [
        rr.AnnotationInfo(id=int(fate), label=name, color=(*FATE_RGB[fate], 255))
        for fate, name in EVENT_STAGE_NAMES.items()
    ]
    for name, camera in cameras.items():
        path = picture_path(name, calibrated=camera is not None)
        stream.log(path, rr.AnnotationContext(colours), static=True)
        if camera is None:
            continue
        pose = rr.Transform3D(translation=camera.position_world_m, mat3x3=camera.T_world_camera[:3, :3])
        stream.log(path.rsplit("/", 1)[0], pose, static=True)
        K = camera.K.copy()
        K[:2, 2] += HALF_PIXEL
        pinhole = rr.Pinhole(
            image_from_camera=K,
            resolution=[camera.sensor.width_px, camera.sensor.height_px],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.45,
            color=(255, 190, 90),
            line_width=0.004,
        )
        stream.log(path, pinhole, static=True)


def _lines() -> rr.LineStrips3D:
    x, y = (TABLE_LENGTH_M - LINE_WIDTH_M) / 2, (TABLE_WIDTH_M - LINE_WIDTH_M) / 2
    edge = [(-x, -y, 0.001), (x, -y, 0.001), (x, y, 0.001), (-x, y, 0.001), (-x, -y, 0.001)]
    return rr.LineStrips3D([edge, [(-x, 0, 0.001), (x, 0, 0.001)]], colors=LINE_RGB, radii=[LINE_WIDTH_M / 2, 0.002])


def _net() -> rr.LineStrips3D:
    half = TABLE_WIDTH_M / 2 + NET_OVERHANG_M
    strings = [[(0, y, 0), (0, y, NET_HEIGHT_M)] for y in np.linspace(-half, half, 41)]
    strings += [[(0, -half, z), (0, half, z)] for z in np.linspace(0, NET_HEIGHT_M, 8)]
    radii = [0.0008] * (len(strings) - 1) + [0.006]
    return rr.LineStrips3D(strings, colors=NET_RGB, radii=radii)
