"""Trials of the assistance on simulated balls, whose centres are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera, stereo_preset
from core.events import Events, SensorSize
from core.geometry import look_at
from core.recordings import PixelTruth
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights import BallPath, BallStates, LaunchConfig, VisibleRange, draw_serve_series
from core.simulation.scenes.scene import SceneConfig, scene_named
from core.simulation.sensor.sensor import SensorConfig
from core.simulation.truth import pixel_truth
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from labels.arrays import LabelArrays, label_arrays
from labels.assist.curve import interpolate
from labels.assist.flight import fit_flight
from labels.assist.propose import Proposals
from labels.assist.review import QueueConfig, review_queue
from labels.assist.snap import SnapConfig, snap
from labels.assist.stereo import check_stereo
from labels.model import Label, LabelState

SENSOR = SensorSize(320, 240)
FOCAL_PX = 1000.0
CLIP_US = 60_000
MIDDLE_US = 30_000


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A ball that flies through the middle of the picture at `MIDDLE_US`."""

    events: Events
    truth: PixelTruth
    """One sample, at `MIDDLE_US`."""
    v_px_per_ms: NDArray[np.float64]
    """(2,)"""


@dataclass(frozen=True, slots=True, eq=False)
class _Throw:
    """A ball that is at `middle` at `MIDDLE_US` and flew freely before and after: no launcher near the picture."""

    middle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    end_s: float = CLIP_US * 1e-6

    @property
    def discontinuities_s(self) -> NDArray[np.float64]:
        return np.empty(0)

    def at(self, t_s: ArrayLike) -> BallStates:
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        since = (t - MIDDLE_US * 1e-6)[:, None]
        drop = np.array([0.0, 0.0, -GRAVITY_MPS2])
        p = self.middle + self.velocity * since + 0.5 * drop * since**2
        return BallStates(t, p, self.velocity + drop * since, np.zeros((len(t), 3)), np.ones(len(t), np.bool_))

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        count = len(np.atleast_1d(np.asarray(t_s)))
        return VisibleRange(np.zeros((count, 3)), np.full(count, -np.inf))


def draw_clip(
    rng: np.random.Generator,
    *,
    speed_mps: float,
    radius_px: float,
    noise_share: float = 0.05,
    scene: str = "ball",
    sensor: SensorConfig | None = None,
) -> Clip:
    """A clip with a ball of this speed and size, a random direction of flight and view, and added noise events.

    Of the events near the ball's way, `noise_share` are noise: uniform in time and place.
    """
    middle = np.array([rng.uniform(-1.0, 1.0), rng.uniform(-0.5, 0.5), 0.45])
    around, down = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 1.0)
    away = np.array([np.cos(around) * np.cos(down), np.sin(around) * np.cos(down), np.sin(down)])
    camera = Camera(
        SENSOR,
        np.array([[FOCAL_PX, 0, 160], [0, FOCAL_PX, 120], [0, 0, 1.0]]),
        np.zeros(5),
        look_at(middle + away * FOCAL_PX * BALL_RADIUS_M / radius_px, middle + rng.normal(0, 0.02, 3)),
    )
    heading = rng.uniform(0, 2 * np.pi)
    velocity = speed_mps * np.array([np.cos(heading), np.sin(heading), rng.uniform(-0.3, 0.3)])
    path = _Throw(middle, velocity)
    look: SceneConfig = scene_named(scene)
    rig = EventCamera(camera, look, sensor or SensorConfig(), rng)
    clean = rig.advance(path, -(-CLIP_US // BLOCK_US) * BLOCK_US)
    truth = pixel_truth(camera, path, [MIDDLE_US])
    near = pixel_truth(camera, path, [MIDDLE_US - 100, MIDDLE_US + 100])
    v = np.array([near.u_px[1] - near.u_px[0], near.v_px[1] - near.v_px[0]]) / 0.2
    return Clip(_with_noise(clean, noise_share, rng), truth, v)


def _with_noise(events: Events, share: float, rng: np.random.Generator) -> Events:
    """Noise in the box that the middle 20 ms of the ball's events take."""
    near = events.between(MIDDLE_US - 10_000, MIDDLE_US + 10_000)
    count = round(share * len(near))
    if not count:
        return events
    low_x, high_x = int(near.x_px.min()), int(near.x_px.max()) + 1
    low_y, high_y = int(near.y_px.min()), int(near.y_px.max()) + 1
    t = np.concatenate([events.t_us, rng.integers(MIDDLE_US - 10_000, MIDDLE_US + 10_000, count)])
    order = np.argsort(t, kind="stable")
    x = np.concatenate([events.x_px, rng.integers(low_x, high_x, count)])[order]
    y = np.concatenate([events.y_px, rng.integers(low_y, high_y, count)])[order]
    on = np.concatenate([events.on, rng.random(count) < 0.5])[order]
    return Events.from_columns(t[order], x, y, on, events.sensor)


Array = NDArray[np.float64]
HUMAN_SIGMA_PX = 0.4
"""How exactly a careful person places a centre, for labels made up in trials."""
FRAME_US = 2000


@dataclass(frozen=True, slots=True, eq=False)
class SnapTrial:
    """N snaps at random balls; nan where none was found."""

    speed_px_per_ms: Array
    error_px: Array
    along_px: Array
    """Signed, positive ahead of the ball."""
    mahalanobis: Array
    """Squared error in units of its covariance."""
    radius_ratio: Array
    """Radius that was found per true radius."""


def try_snap(
    count: int, rng: np.random.Generator, config: SnapConfig | None = None, *, scene: str = "ball"
) -> SnapTrial:
    """Speeds 0 to 20 m/s, radii 3 to 15 px, 5 % noise, clicks 1.5 px off."""
    rows = np.full((count, 5), np.nan)
    for row in range(count):
        clip = draw_clip(rng, speed_mps=rng.uniform(0, 20), radius_px=rng.uniform(3, 15), scene=scene)
        truth = np.array([clip.truth.u_px[0], clip.truth.v_px[0]])
        click = truth + rng.normal(0, 1.5, 2)
        found = snap(clip.events, MIDDLE_US, click[0], click[1], config=config)
        speed = float(np.hypot(*clip.v_px_per_ms))
        rows[row, 0] = speed
        if found is None:
            continue
        error = np.array([found.x_px, found.y_px]) - truth
        xx, xy, yy = found.covariance_px2
        covariance = np.array([[xx, xy], [xy, yy]])
        along = float(error @ clip.v_px_per_ms) / max(speed, 1e-9)
        rows[row, 1:4] = np.hypot(*error), along, error @ np.linalg.solve(covariance, error)
        rows[row, 4] = found.r_px / clip.truth.r_px[0]
    return SnapTrial(*rows.T)


@dataclass(frozen=True, slots=True, eq=False)
class TrialServes:
    """A few simulated serves in both cameras: the truth on a grid of frames."""

    path: BallPath
    cameras: dict[str, Camera]
    truth: dict[str, PixelTruth]
    bounces_us: tuple[int, ...]


def make_serves(count: int, rng: np.random.Generator, *, frame_us: int = FRAME_US) -> TrialServes:
    """Serves of 4 to 8 m/s seen from the side."""
    path = draw_serve_series([LaunchConfig(speed_mps=float(rng.uniform(4, 8))) for _ in range(count)], rng)
    cameras = stereo_preset("side")
    times = np.arange(0, round(path.end_s * 1e6), frame_us)
    truth = {name: pixel_truth(camera, path, times) for name, camera in cameras.items()}
    return TrialServes(path, cameras, truth, tuple(np.round(path.discontinuities_s * 1e6).astype(int).tolist()))


def made_up_labels(truth: PixelTruth, rng: np.random.Generator, sigma_px: float = HUMAN_SIGMA_PX) -> LabelArrays:
    """A label for every frame, as a careful person would make them."""
    labels = []
    for t, u, v, r, visible in zip(truth.t_us.tolist(), truth.u_px, truth.v_px, truth.r_px, truth.visible, strict=True):
        if visible:
            x, y = u + rng.normal(0, sigma_px), v + rng.normal(0, sigma_px)
            labels.append(Label(t_us=t, state=LabelState.VISIBLE, x_px=float(x), y_px=float(y), r_px=float(r)))
        else:
            labels.append(Label(t_us=t, state=LabelState.NO_BALL))
    return label_arrays(labels)


@dataclass(frozen=True, slots=True, eq=False)
class InterpolationTrial:
    """Errors at the frames between the keyframes, where something was interpolated."""

    curve_px: Array
    flight_px: Array
    linear_px: Array
    """The baseline, at the frames of `curve_px`."""
    curve_share: float
    """Of the frames between two keyframes that see the ball, how many were interpolated."""
    flight_share: float
    across_px: Array
    """Errors in gaps with a bounce that the keyframes do not show: it is within their noise."""


def try_interpolation(serves: int, every: int, rng: np.random.Generator, *, sigma_px: float) -> InterpolationTrial:
    """Label every n-th frame, interpolate the rest; bounces are found, not told."""
    scene = make_serves(serves, rng)
    names = list(scene.cameras)
    every_label = {name: made_up_labels(scene.truth[name], rng, sigma_px) for name in names}
    keys = {name: labels.rows(slice(None, None, every)) for name, labels in every_label.items()}
    curve_px: list[Array] = []
    flight_px: list[Array] = []
    linear_px: list[Array] = []
    across_px: list[Array] = []
    wanted = in_flight = 0
    for name in names:
        truth, key = scene.truth[name], keys[name]
        seen_keys = key.rows(key.seen)
        rest = truth.visible & (np.arange(len(truth.t_us)) % every != 0)
        gap = np.searchsorted(key.t_us, truth.t_us)  # keyframes on both sides must see the ball
        inner = (gap > 0) & (gap < len(key))
        rest &= inner
        rest[rest] &= key.seen[gap[rest] - 1] & key.seen[gap[rest]]
        broken = np.zeros(len(rest), np.bool_)
        for bounce in scene.bounces_us:
            after = int(np.searchsorted(key.t_us, bounce, side="right"))
            if 0 < after < len(key):
                broken |= (key.t_us[after - 1] < truth.t_us) & (truth.t_us < key.t_us[after])
        found = interpolate(key, truth.t_us)
        across = rest & broken & found.covered
        across_px.append(np.hypot(found.x_px - truth.u_px, found.y_px - truth.v_px)[across])
        good = rest & ~broken
        wanted += int(good.sum())
        here = good & found.covered
        curve_px.append(np.hypot(found.x_px - truth.u_px, found.y_px - truth.v_px)[here])
        straight = [np.interp(truth.t_us[here], seen_keys.t_us, column) for column in (seen_keys.x_px, seen_keys.y_px)]
        linear_px.append(np.hypot(straight[0] - truth.u_px[here], straight[1] - truth.v_px[here]))
        for number in np.unique(found.segment[here]):
            times = found.t_us[found.segment == number]
            parts = tuple(keys[other].between(int(times[0]), int(times[-1]) + 1) for other in names)
            flight = fit_flight((scene.cameras[names[0]], scene.cameras[names[1]]), (parts[0], parts[1]))
            if flight is None:
                continue
            inside = here & (flight.start_us <= truth.t_us) & (truth.t_us <= flight.end_us)
            seen = flight.seen_by(scene.cameras[name], truth.t_us[inside])
            in_flight += int(inside.sum())
            flight_px.append(np.hypot(seen[:, 0] - truth.u_px[inside], seen[:, 1] - truth.v_px[inside]))
    curve, flights = np.concatenate(curve_px), np.concatenate(flight_px)
    return InterpolationTrial(
        curve, flights, np.concatenate(linear_px), len(curve) / wanted, in_flight / wanted, np.concatenate(across_px)
    )


@dataclass(frozen=True, slots=True)
class StereoTrial:
    """Shares of labels that the cameras' disagreement flags."""

    flagged: float
    """Of labels moved across the epipolar line."""
    false_flags: float
    """Of good labels."""
    flagged_along: float
    """Of labels moved along the epipolar line, which nothing can see."""


FLAG_SIGMAS = 2.6


def try_stereo_flags(serves: int, error_px: float, rng: np.random.Generator) -> StereoTrial:
    """Move labels of one camera by `error_px` across and along the epipolar line of the other's true position."""
    scene = make_serves(serves, rng)
    (left, right), (here, there) = scene.cameras.values(), scene.truth.values()
    both = here.visible & there.visible
    uv_here, uv_there = (np.column_stack([part.u_px, part.v_px])[both] for part in (here, there))
    depth = left.unproject(uv_here) * np.linalg.norm(
        check_stereo(left, uv_here, right, uv_there).p_world_m - left.position_world_m, axis=1, keepdims=True
    )
    line = right.project(left.position_world_m + 1.01 * depth) - right.project(left.position_world_m + 0.99 * depth)
    along = line / np.linalg.norm(line, axis=1, keepdims=True)
    across = np.column_stack([-along[:, 1], along[:, 0]]) * rng.choice([-1, 1], (len(along), 1))
    noisy = [uv + rng.normal(0, HUMAN_SIGMA_PX, uv.shape) for uv in (uv_here, uv_there)]

    def flags(moved: Array) -> float:
        residual = check_stereo(left, noisy[0], right, moved).residual_px
        return float((residual > FLAG_SIGMAS * HUMAN_SIGMA_PX).mean())

    return StereoTrial(flags(noisy[1] + error_px * across), flags(noisy[1]), flags(noisy[1] + error_px * along))


@dataclass(frozen=True, slots=True)
class QueueTrial:
    """Where injected errors stand in the queue."""

    labels: int
    injected: int
    in_first_tenth: float
    """Share of the injected errors that stand among the first 10 % (of the number of labels)."""


def try_queue(serves: int, rng: np.random.Generator, *, with_detector: bool, share: float = 0.03) -> QueueTrial:
    """Spoil 3 % of the labels: moved by 5 to 30 px, swapped with another frame's, missed, or made up."""
    scene = make_serves(serves, rng)
    (left, right), (here, there) = scene.cameras.values(), scene.truth.values()
    labels, others = made_up_labels(here, rng), made_up_labels(there, rng)
    x, y, state = labels.x_px.copy(), labels.y_px.copy(), labels.state.copy()
    visible, hidden = np.flatnonzero(labels.seen), np.flatnonzero(~labels.seen)
    bad = rng.permutation(visible)[: round(share * len(visible))]
    for number, row in enumerate(bad):
        match number % 4:
            case 0 | 1:
                angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(5, 30)
                x[row], y[row] = x[row] + size * np.cos(angle), y[row] + size * np.sin(angle)
            case 2:
                other = visible[(np.searchsorted(visible, row) + 8) % len(visible)]
                x[row], y[row] = labels.x_px[other], labels.y_px[other]
            case _:
                state[row] = labels.state[hidden[0]]
                x[row] = y[row] = np.nan
    made_up = rng.permutation(hidden)[: max(1, len(bad) // 4)]
    state[made_up] = labels.state[visible[0]]
    x[made_up], y[made_up] = rng.uniform(0, 1279, len(made_up)), rng.uniform(0, 719, len(made_up))
    spoiled = LabelArrays(labels.t_us, x, y, labels.r_px, state, labels.source)
    injected = {*labels.t_us[bad].tolist(), *labels.t_us[made_up].tolist()}
    residual = check_stereo(
        left, np.column_stack([x, y]), right, np.column_stack([others.x_px, others.y_px])
    ).residual_px
    queue = review_queue(
        spoiled,
        proposals=_made_up_detector(here, rng) if with_detector else None,
        stereo_residual_px=residual,
        config=QueueConfig(sigma_px=HUMAN_SIGMA_PX),
    )
    first = {item.t_us for item in queue[: len(labels) // 10]}
    return QueueTrial(len(labels), len(injected), len(injected & first) / len(injected))


def _made_up_detector(truth: PixelTruth, rng: np.random.Generator) -> Proposals:
    """Like the project's own: 95 % recall, 0.3 px, 1 % of its answers somewhere else."""
    rows = np.flatnonzero(truth.visible & (rng.random(len(truth.t_us)) < 0.95))
    x = truth.u_px[rows] + rng.normal(0, 0.3, len(rows))
    y = truth.v_px[rows] + rng.normal(0, 0.3, len(rows))
    wrong = rng.random(len(rows)) < 0.01
    x[wrong], y[wrong] = rng.uniform(0, 1279, wrong.sum()), rng.uniform(0, 719, wrong.sum())
    covariance = np.tile([0.1, 0.0, 0.1], (len(rows), 1))
    return Proposals(truth.t_us[rows], x, y, truth.r_px[rows], covariance, FRAME_US, "made up")
