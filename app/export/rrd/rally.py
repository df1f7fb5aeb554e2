"""Rerun entities of a rally: table, net, hitting plane and cameras; the moving ball, its prediction, the racket,
landing points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from app.export.rrd.camera import EVENT_STAGE_NAMES, EventStage
from app.export.rrd.paths import (
    BALL,
    HALF_PIXEL,
    LANDINGS,
    PREDICTION,
    RACKET,
    RACKET_TARGET,
    TRAIL,
    WORLD,
    lengths_of,
    one_a_row,
    picture_path,
    send,
    stacked,
    time_column,
)
from app.scene.arena import BLADE_RADIUS_M
from app.scene.prediction import CASE_NAMES, CASE_RGB, PLACE_RGB, PLANE_HEIGHT_M, PLANE_WIDTH_M, REFUSED_RGB, SIGMAS
from core.cameras import Camera
from core.chain import BallPoint
from core.geometry import quaternion_from_matrix, xyzw_from_wxyz
from core.physics.episode import Case
from core.recordings import BallTruth
from core.recordings.layout import Rows
from core.table import (
    BALL_RADIUS_M,
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)
from core.trajectory import Prediction

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
BLADE_M = 0.012
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
    send(stream, f"{path}/blade", time_column([first_us]), one_a_row(blade, 1))
    send(stream, f"{path}/handle", time_column([first_us]), one_a_row(handle, 1))


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


BALL_RGB = (255, 140, 30)
TRUTH_RGB = (40, 220, 220)
BEFORE_RGB = (255, 214, 10)
AFTER_RGB = (30, 225, 110)
RECORDED_RGB = (230, 120, 255)
TARGET_RGB = (255, 90, 10)
MIN_HALF_SIZE_M = 0.004
ABOVE_M = 0.004
EPISODE_US = 1_500_000
"""Longest duration of an episode."""


def send_ball(
    stream: rr.RecordingStream, t_us: Sequence[int], points: Sequence[BallPoint | None], *, cameras: bool = False
) -> None:
    """The triangulated ball, a row per window; its trail is the same points, of which a view shows the last.

    With `cameras` a label, shown when it is pointed at, says which cameras a point is made of.
    """
    found = [point for point in points if point is not None]
    if not found:
        return
    seen = [point is not None for point in points]
    times, positions = time_column(t_us), np.array([point.p_world_m for point in found], np.float32)
    ball = rr.Points3D.columns(
        positions=positions,
        radii=[1.3 * BALL_RADIUS_M] * len(found),
        colors=[BALL_RGB] * len(found),
        labels=[", ".join(point.uvs_px) for point in found] if cameras else None,
    )
    if cameras:
        stream.log(f"{BALL}/triangulated", rr.Points3D.from_fields(show_labels=False), static=True)
    send(stream, f"{BALL}/triangulated", times, ball.partition(seen))
    trail = rr.Points3D.columns(positions=positions, radii=[0.008] * len(found), colors=[BALL_RGB] * len(found))
    send(stream, TRAIL, times, trail.partition(seen))


def send_ball_truth(stream: rr.RecordingStream, truth: BallTruth, rows: slice) -> None:
    """The true ball at its own times."""
    visible = truth.visible[rows]
    count = int(visible.sum())
    if not count:
        return
    ball = rr.Points3D.columns(
        positions=truth.p_world_m[rows][visible].astype(np.float32),
        radii=[BALL_RADIUS_M] * count,
        colors=[TRUTH_RGB] * count,
    )
    send(stream, f"{BALL}/truth", time_column(truth.t_us[rows]), ball.partition(visible.astype(np.int32)))


def send_predictions(
    stream: rr.RecordingStream,
    t_us: Sequence[int],
    predictions: Sequence[Prediction | None],
    cameras: Sequence[Sequence[str]] | None = None,
) -> None:
    """The predicted flight at each time, with the uncertainty of its bounces and of the hit; nothing where none is.

    With `cameras`, those of each prediction, a label of the flight, shown when it is pointed at, names them.
    """
    times = time_column(t_us)
    curves = [None if one is None or len(one.curve_t_s) < 2 else one for one in predictions]
    at = [number for number, one in enumerate(curves) if one is not None]
    shown = [one for one in curves if one is not None]
    if not shown:
        return
    lines = rr.LineStrips3D.columns(
        strips=[one.curve_ps_world_m.astype(np.float32) for one in shown],
        colors=[BEFORE_RGB if one.stage == "pre" else AFTER_RGB for one in shown],
        radii=[0.005] * len(shown),
        labels=None if cameras is None else [", ".join(cameras[number]) for number in at],
        show_labels=None if cameras is None else [False] * len(shown),
    )
    send(stream, f"{PREDICTION}/flight", times, lines.partition([one is not None for one in curves]))
    touches = [[] if one is None else [(b.p_world_m, b.sigma_m) for b in one.bounces] for one in predictions]
    _send_ellipsoids(stream, f"{PREDICTION}/bounce", times, touches, BEFORE_RGB)
    hits = [
        [] if one is None or one.hit_plane is None else [(one.hit_plane.p_world_m, one.hit_plane.sigma_m)]
        for one in predictions
    ]
    _send_ellipsoids(stream, f"{PREDICTION}/hit", times, hits, AFTER_RGB)


def send_recorded_predictions(stream: rr.RecordingStream, rows: Rows) -> None:
    """Send the recorded predictions of the ball at the hitting plane, with a label that names their cameras."""
    variances = np.diagonal(rows["cov"][:, :3, :3], axis1=1, axis2=2)
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    known = np.isfinite(rows["p_hit_m"].sum(axis=1)).tolist()
    points = [
        [(p, np.nan_to_num(sigma))] if ok else [] for p, sigma, ok in zip(rows["p_hit_m"], sigmas, known, strict=True)
    ]
    names = rows.get("cameras")  # not in files of older versions
    texts = (
        None if names is None else [text.decode(errors="replace").replace("+", ", ") for text in names[known].tolist()]
    )
    _send_ellipsoids(stream, f"{PREDICTION}/recorded_hit", time_column(rows["t_us"]), points, RECORDED_RGB, texts)


def send_hit_choices(stream: rr.RecordingStream, rows: Rows) -> None:
    """Send the places where a ball could be hit, or not and why: the chosen one as large as the ball."""
    times_us, counts = np.unique(rows["t_us"], return_counts=True)
    chosen, refused = rows["chosen"].astype(bool), rows["why_not"] != b""
    colours = np.where(refused[:, None], REFUSED_RGB, PLACE_RGB).astype(np.uint8)
    colours[chosen] = AFTER_RGB
    chances = [f"{chance:.0%} comes back" for chance in rows["chance"].tolist()]
    reasons = [why.decode("ascii", "replace") for why in rows["why_not"].tolist()]
    columns = rr.Points3D.columns(
        positions=rows["p_hit_m"].astype(np.float32),
        colors=colours,
        radii=np.where(chosen, BALL_RADIUS_M, BALL_RADIUS_M / 3),
        labels=[why or chance for why, chance in zip(reasons, chances, strict=True)],
        show_labels=[False] * len(chosen),
    )
    send(stream, f"{PREDICTION}/hit_places", time_column(times_us), columns.partition(counts.astype(np.int32)))


def send_racket(stream: rr.RecordingStream, rows: Rows) -> None:
    """Send the racket's pose at the times of the recording."""
    send_racket_shape(stream, RACKET, int(rows["t_us"][0]))
    pose = rr.Transform3D.columns(
        translation=rows["p_world_m"].astype(np.float32), quaternion=xyzw_from_wxyz(rows["q_world_wxyz"])
    )
    send(stream, RACKET, time_column(rows["t_us"]), pose)


def send_racket_targets(stream: rr.RecordingStream, rows: Rows) -> None:
    """Send the racket's targets and the landing targets."""
    send_racket_shape(stream, RACKET_TARGET, int(rows["t_us"][0]))
    times = time_column(rows["t_us"])
    pose = rr.Transform3D.columns(
        translation=rows["p_world_m"].astype(np.float32), quaternion=xyzw_from_wxyz(rows["q_world_wxyz"])
    )
    send(stream, RACKET_TARGET, times, pose)
    _send_spots(stream, f"{WORLD}/target", times, rows["g"][:, :2], [TARGET_RGB] * len(rows["g"]), None, 0.03)


def send_episodes(stream: rr.RecordingStream, rows: Rows) -> None:
    """Send where each ball landed, by its case, shown from the next serve on."""
    serves_us = rows["serve_us"].astype(np.int64)
    times = time_column(np.append(serves_us[1:], serves_us[-1] + EPISODE_US))
    cases = [Case(int(case)) for case in rows["case"]]
    colours, names = [CASE_RGB[case] for case in cases], [CASE_NAMES[case] for case in cases]
    _send_spots(stream, LANDINGS, times, rows["f"][:, :2], colours, names, 0.025)


def _send_spots(
    stream: rr.RecordingStream,
    path: str,
    times: rr.TimeColumn,
    spots_m: NDArray[np.float64],
    colours: Sequence[tuple[int, int, int]],
    names: Sequence[str] | None,
    radius_m: float,
) -> None:
    known = np.isfinite(spots_m).all(axis=1)
    if not known.any():
        return
    at = np.flatnonzero(known).tolist()
    columns = rr.Points3D.columns(
        positions=np.column_stack([spots_m[known], np.full(len(at), ABOVE_M)]).astype(np.float32),
        colors=[colours[k] for k in at],
        radii=[radius_m] * len(at),
        labels=None if names is None else [names[k] for k in at],
        show_labels=None if names is None else [False] * len(at),
    )
    send(stream, path, times, columns.partition(known.astype(np.int32)))


def _send_ellipsoids(
    stream: rr.RecordingStream,
    path: str,
    times: rr.TimeColumn,
    rows: Sequence[Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]],
    colour: tuple[int, int, int],
    labels: Sequence[str] | None = None,
) -> None:
    count = sum(len(row) for row in rows)
    if not count:
        return
    centres = stacked([np.array([p for p, _ in row]) for row in rows if row], 3)
    halves = stacked([SIGMAS * np.array([sigma for _, sigma in row]) for row in rows if row], 3)
    columns = rr.Ellipsoids3D.columns(
        centers=centres,
        half_sizes=np.maximum(halves, MIN_HALF_SIZE_M),
        colors=[colour] * count,
        labels=labels,
        show_labels=None if labels is None else [False] * count,
    )
    send(stream, path, times, columns.partition(lengths_of(rows)))
