"""What the simulation knows: the ball in the world and its outline in each picture, at any time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.jit import njit
from core.recordings import BallTruth, PixelTruth
from core.simulation.bodies import MovingBodies, hidden_by_bodies
from core.simulation.flights import BallPath
from core.simulation.scenes.ball_view import ball_circles_at
from core.simulation.scenes.racket_view import RacketPath, RacketPoses, racket_gap, racket_shading_rows
from core.simulation.scenes.scene import NET_TAPE_M
from core.table import BALL_RADIUS_M, NET_HEIGHT_M, NET_OVERHANG_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
TRUTH_STEP_US = 500
"""Between samples a ball bends by less than 0.002 px from a straight line at 9 m/s, 1.5 m away."""
WHOLE = 1.05
"""The ball counts as visible once it is out of the launcher by this many radii beyond its centre."""


def truth_times(path: BallPath, start_us: int, end_us: int) -> NDArray[np.int64]:
    """Every 500 us in [start, end), and every kink of the path, so that linear interpolation holds across bounces."""
    regular = np.arange(start_us, end_us, TRUTH_STEP_US, dtype=np.int64)
    kinks = np.round(path.discontinuities_s * 1e6).astype(np.int64)
    kinks = kinks[(start_us <= kinks) & (kinks < end_us)]
    return np.union1d(regular, kinks) if len(kinks) else regular


def ball_truth(path: BallPath, t_us: ArrayLike) -> BallTruth:
    """The ball in the world at ascending times `t_us` (N,)."""
    t = np.atleast_1d(np.asarray(t_us, np.int64))
    states = path.at(t * 1e-6)
    return BallTruth(t, states.p_world_m, states.v_world_mps, states.spin_radps, states.present)


def pixel_truth(
    camera: Camera,
    path: BallPath,
    t_us: ArrayLike,
    bodies: MovingBodies | None = None,
    racket: RacketPath | None = None,
) -> PixelTruth:
    """Outline centre and radius in a camera at ascending times `t_us` (N,); nan and not visible where there is none.

    Visible means: the whole ball is out of its launcher, its centre is on the sensor, and neither the table nor the
    tape of the net, nor one of the `bodies`, nor the robot's `racket` is in front of the centre. The mesh of the net
    hides nothing.

    Args:
        camera: lens, pose and sensor.
        path: the ball's flights.
        t_us: (N,) times, ascending.
        bodies: what may hide the ball.
        racket: what may hide it.
    """
    return pixel_truths({"": camera}, path, t_us, bodies, racket)[""]


def pixel_truths(
    cameras: Mapping[str, Camera],
    path: BallPath,
    t_us: ArrayLike,
    bodies: MovingBodies | None = None,
    racket: RacketPath | None = None,
) -> dict[str, PixelTruth]:
    """`pixel_truth` for each of several cameras.

    Args:
        cameras: by name.
        path: the ball's flights.
        t_us: (N,) times, ascending.
        bodies: what may hide the ball.
        racket: what may hide it.
    """
    t = np.atleast_1d(np.asarray(t_us, np.int64))
    t_s = np.asarray(t * 1e-6, np.float64)
    states = path.at(t_s)
    if not states.present.any():
        u, v, r = np.full((3, len(t)), np.nan)
        return {name: PixelTruth(t, u, v, r, np.zeros(len(t), np.bool_)) for name in cameras}
    visible_range, poses = path.visible_range(t_s), None if racket is None else racket.at(t_s)
    with np.errstate(invalid="ignore"):
        out = (
            np.einsum("ij,ij->i", visible_range.normal_world, states.p_world_m)
            > visible_range.offset_m + WHOLE * BALL_RADIUS_M
        )
    truths = {}
    for name, camera in cameras.items():
        circles = ball_circles_at(camera, states.p_world_m)
        width, height = camera.sensor.width_px, camera.sensor.height_px
        with np.errstate(invalid="ignore"):
            # Pixel 0 reaches from -0.5 to 0.5: its address is its centre.
            on_sensor = (np.abs(circles.u_px - (width - 1) / 2) <= width / 2) & (
                np.abs(circles.v_px - (height - 1) / 2) <= height / 2
            )
            visible = states.present & out & on_sensor & ~_hidden(camera.position_world_m, states.p_world_m)
        if bodies is not None:
            visible &= ~hidden_by_bodies(bodies, camera.position_world_m, states.p_world_m, t_s)
        if racket is not None and poses is not None:
            visible &= ~_behind_racket(camera, racket, poses, states.p_world_m)
        u, v, r = (np.where(visible, column, np.nan) for column in (circles.u_px, circles.v_px, circles.r_px))
        truths[name] = PixelTruth(t, u, v, r, visible)
    return truths


def _behind_racket(camera: Camera, racket: RacketPath, poses: RacketPoses, ps: Array) -> NDArray[np.bool_]:
    """Whether the racket's body lies before points (N, 3)."""
    hidden = np.empty(len(ps), np.bool_)
    _before_points(racket_shading_rows(camera, 0.0, 0.0, racket, poses), camera.to_camera(ps), hidden)
    return hidden


@njit(error_model="numpy")
def _before_points(rackets, ps, hidden):
    for index in range(len(ps)):
        x, y, z = ps[index]
        gap, at_m = racket_gap(rackets[index], x / z, y / z)
        hidden[index] = gap < 0 and at_m < z


def _hidden(eye: NDArray[np.float64], ps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether table, floor or net tape lie between `eye` and points (N, 3)."""
    hidden = np.empty(len(ps), np.bool_)
    _behind_table(eye, ps, hidden)
    return hidden


@njit(error_model="numpy")
def _behind_table(eye, ps, hidden):
    for index in range(len(ps)):
        dx, dy, dz = ps[index, 0] - eye[0], ps[index, 1] - eye[1], ps[index, 2] - eye[2]
        at_table, at_net = -eye[2] / dz, -eye[0] / dx  # shares of the way
        x, y = eye[0] + at_table * dx, eye[1] + at_table * dy
        behind_table = 0 < at_table < 1 and abs(x) < TABLE_LENGTH_M / 2 and abs(y) < TABLE_WIDTH_M / 2
        y, z = eye[1] + at_net * dy, eye[2] + at_net * dz
        behind_tape = (
            0 < at_net < 1
            and abs(y) < TABLE_WIDTH_M / 2 + NET_OVERHANG_M
            and abs(z - (NET_HEIGHT_M - NET_TAPE_M / 2)) < NET_TAPE_M / 2
        )
        hidden[index] = behind_table or behind_tape or ps[index, 2] < BALL_RADIUS_M - TABLE_HEIGHT_M
