"""One method on one recording: everything that the report says of it.

A camera's events are all in memory, so what a detector's windows cost is the detector's own time. Beside the method's
own figures: how soon a ball that appears, or comes back, is found; the chain's points in space, and the hitting points
that it predicts 100 ms before the ball is there; and what no method can do better: a circle through the events that
were seen, and reading each event once.
"""

from __future__ import annotations

import hashlib
import math
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.results import METHODS, PerceptionResult, RecordingReading, ShownAnswer, chain_of, rounded
from core.cameras import Camera
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.chain.follow import calibrated_cameras, true_positions
from core.detection import DetectorConfig, make_detector
from core.detection.methods import Method, method_config
from core.detection.refined_config import RefinedConfig
from core.detection.window import windows_between, windows_side_by_side
from core.detection.yolo.detector import YoloDetector
from core.detection.yolo.weights import SHIPPED, YoloWeights, load_weights
from core.events import Events, SensorSize
from core.jit import njit
from core.jobs.control import one_torch_thread
from core.metrics.delay import ANY_SPEED, find_delay_us, without_delay
from core.metrics.grid_score import GridScore, image_velocity, score_on_grid, wholly_in_view
from core.metrics.run import TimedDetector, WindowAnswers, run_detector, run_on_frames
from core.metrics.score import MATCH_RADIUS_PX
from core.metrics.streaming import InTimeErrors, arrival_times, asked_times, errors_in_time
from core.recordings import BallTruth, CameraStream, PixelTruth, Triggers
from core.recordings.frames import FrameStream, frame_windows
from core.recordings.reader import FileRecording
from core.trajectory import Prediction


@dataclass(frozen=True, slots=True, eq=False)
class LoadedCamera:
    """One camera of a recording, read once; everything but the events is the recording's."""

    stream: CameraStream
    events: Events
    known: PixelTruth
    """Where the ball is."""

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self.stream.name

    @property
    def sensor(self) -> SensorSize:
        """Sensor size of the camera."""
        return self.stream.sensor

    @property
    def event_count(self) -> int:
        """Number of events."""
        return len(self.events)

    @property
    def calibration(self) -> Camera | None:
        """Calibration of the camera."""
        return self.stream.calibration

    @property
    def triggers(self) -> Triggers:
        """Triggers of the recording."""
        return self.stream.triggers

    @property
    def truth(self) -> PixelTruth:
        """Where the ball is."""
        return self.known

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)

    def counts_per_ms(self) -> NDArray[np.int64]:
        return self.stream.counts_per_ms()


def load_camera(stream: CameraStream) -> LoadedCamera:
    """Read all events of a camera of a simulated recording."""
    truth = stream.truth
    assert truth is not None, "simulated recordings know where the ball is"
    return LoadedCamera(stream, stream.slice(0, 1000 * len(stream.counts_per_ms())), truth)


AWAY_US: Final = 5000
"""A ball that could not be seen for so long has to be found again."""
STAYS_US: Final = 10_000
"""Shorter sights of a ball are not counted."""


def recovery_times_ms(answers: WindowAnswers, truth: PixelTruth) -> list[float | None]:
    """From each appearance of the ball to the end of the first window with a right answer; None if it went without."""
    there = truth.at(answers.t_us)
    off_px = np.hypot(answers.u_px - there.u_px, answers.v_px - there.v_px)
    right = answers.detected & there.visible & (np.nan_to_num(off_px, nan=np.inf) <= MATCH_RADIUS_PX)
    times: list[float | None] = []
    for start_us, end_us in appearances(truth):
        ends = answers.end_us[right & (answers.t_us >= start_us) & (answers.t_us <= end_us)]
        times.append(float(ends.min() - start_us) / 1000 if len(ends) else None)
    return times


def appearances(truth: PixelTruth) -> list[tuple[int, int]]:
    """First and last time of each sight of the ball that began after it had been away."""
    edges: NDArray[np.intp] = np.flatnonzero(np.diff(np.concatenate([[False], truth.visible, [False]]).astype(np.int8)))
    found: list[tuple[int, int]] = []
    last_us = int(truth.t_us[0]) if len(truth.t_us) else 0
    for first, after in edges.reshape(-1, 2).tolist():
        start_us, end_us = int(truth.t_us[first]), int(truth.t_us[after - 1])
        if start_us - last_us >= AWAY_US and end_us - start_us >= STAYS_US:
            found.append((start_us, end_us))
        last_us = end_us
    return found


Array = NDArray[np.float64]
LEAD_US: Final = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCrossing:
    """A ball that came to the hitting plane."""

    start_us: int
    """Since then it had been flying towards it: what was predicted before is of another flight."""
    t_us: int
    p_world_m: Array
    """(3,)"""


@dataclass(frozen=True, slots=True, eq=False)
class ChainErrors:
    """How far off the chain was."""

    point_mm: Array
    """(N,) of the points at times when there was a ball."""
    points_without_ball: int
    hits: int
    hit_mm: list[float]
    """Along the hitting plane, of the balls that a prediction was there for."""


def plane_crossings(ball: BallTruth, hit_x_m: float) -> list[PlaneCrossing]:
    """Every time that the ball flies through the plane towards the robot's side, linear between the samples."""
    x, flying = ball.p_world_m[:, 0], ball.visible & (ball.v_world_mps[:, 0] < 0)
    with np.errstate(invalid="ignore"):
        through = flying[:-1] & flying[1:] & (x[:-1] > hit_x_m) & (x[1:] <= hit_x_m)
    found: list[PlaneCrossing] = []
    for row in np.flatnonzero(through).tolist():
        still = np.flatnonzero(~flying[: row + 1])
        start = int(still[-1]) + 1 if len(still) else 0
        share = (x[row] - hit_x_m) / (x[row] - x[row + 1])
        t_us = ball.t_us[row] + share * (ball.t_us[row + 1] - ball.t_us[row])
        p = ball.p_world_m[row] + share * (ball.p_world_m[row + 1] - ball.p_world_m[row])
        found.append(PlaneCrossing(int(ball.t_us[start]), round(float(t_us)), p))
    return found


def space_errors(
    loaded: Mapping[str, LoadedCamera],
    cameras: Mapping[str, Camera],
    ball: BallTruth,
    chain: ChainConfig,
    delay_us: int = 0,
) -> ChainErrors:
    """Follow the ball with the chain, all cameras window by window, and compare with where it was.

    `delay_us`, the mean of the cameras, is taken out of the points' times. A hitting point is a place: no constant
    delay moves it.
    """
    follower = RallyChain(cameras, chain)
    end_us = 1000 * min(len(camera.counts_per_ms()) for camera in loaded.values())
    times: list[int] = []
    points: list[Array] = []
    ends: list[int] = []
    said: list[Prediction | None] = []
    for windows in windows_side_by_side(loaded, 0, end_us, chain.detector.window.window_us):
        state = follower.step(windows)
        ends.append(state.t_us)
        said.append(state.prediction)
        if state.point is not None:
            times.append(state.point.t_us)
            points.append(state.point.p_world_m)
    there = true_positions(ball, np.array(times, np.int64) - delay_us)
    off_m = np.linalg.norm(np.array(points).reshape(-1, 3) - there, axis=1)
    known = np.isfinite(off_m)
    crossings = plane_crossings(ball, chain.predictor.hit_x_m)
    errors = [hit_error_mm(crossing, ends, said) for crossing in crossings]
    told = [error for error in errors if error is not None]
    return ChainErrors(1e3 * off_m[known], int((~known).sum()), len(crossings), told)


def hit_error_mm(crossing: PlaneCrossing, ends_us: list[int], said: list[Prediction | None]) -> float | None:
    """Error of the prediction 100 ms before the hit, mm; None if there was none."""
    step = bisect_right(ends_us, crossing.t_us - LEAD_US) - 1
    newest = said[step] if step >= 0 else None
    if newest is None or newest.t_us < crossing.start_us or newest.hit_plane is None:
        return None
    off = newest.hit_plane.p_world_m - crossing.p_world_m
    return 1e3 * float(np.hypot(off[1], off[2]))


SENSOR_DELAY_US: Final = RefinedConfig().delay_us
"""From the light to the event, of the simulated sensor: the photoreceptor's."""
PIXEL_SIGMA_PX: Final = 1 / math.sqrt(12)
"""0.29: an event says of the edge that it was somewhere in its pixel."""
RIM_PX: Final = 1.5
"""An event so near the true circle is of the ball's edge."""
STEP_US: Final = 10_000
MEDIAN_OF_RAYLEIGH: Final = math.sqrt(2 * math.log(2))
READS: Final = 5


class CircleBounds(NamedTuple):
    """Least median errors of a circle's centre in pixels."""

    events_px: float
    """If every event were an observation of its own."""
    pixels_px: float
    """If a pixel says the same however many events it has."""


def circle_bound_px(points: int) -> float:
    """Least median distance of a fitted centre from the true one; endless without points.

    n points on a circle, each with a radial error of sigma = 1/sqrt(12) px, know the centre no better than the inverse
    of their Fisher information, sum(n_i n_i^T) / sigma^2 with the unit normals n_i. Its trace is n / sigma^2 whatever
    the points; the sum of both variances is least when they lie all round: 2 sigma^2 / n for each axis. The distance is
    then Rayleigh distributed, with the median sqrt(2 ln 2) sigma sqrt(2 / n).
    """
    if points <= 0:
        return math.inf
    return MEDIAN_OF_RAYLEIGH * PIXEL_SIGMA_PX * math.sqrt(2 / points)


def circle_bounds(camera: LoadedCamera, method: Method, config: DetectorConfig) -> list[CircleBounds]:
    """The bounds at times 10 ms apart with the ball in view, for the events that the method looks back on."""
    truth = camera.truth
    if not len(truth.t_us):
        return []
    times_us = np.arange(truth.t_us[0], truth.t_us[-1], STEP_US)
    seen = times_us[wholly_in_view(truth.at(times_us), camera.sensor)]
    speeds = np.linalg.norm(image_velocity(truth, seen), axis=1)
    found = []
    for t_us, speed in zip(seen.tolist(), speeds.tolist(), strict=True):
        events = camera.slice(t_us - look_back_us(method, config, speed), t_us)
        edge = edge_events(events, truth)
        if len(edge):
            pixels = len(np.unique(edge.y_px.astype(np.int64) * camera.sensor.width_px + edge.x_px))
            found.append(CircleBounds(circle_bound_px(len(edge)), circle_bound_px(pixels)))
    return found


def look_back_us(method: Method, config: DetectorConfig, speed_px_per_ms: float) -> int:
    """The events of an answer are so old: those of one window, and of `refined` those of its history."""
    if method != "refined":
        return config.window.window_us
    refined = config.refined
    wanted = 1000 * refined.motion_px / max(speed_px_per_ms, 1e-6)
    return round(min(max(wanted, refined.history_min_us), refined.history_max_us))


def edge_events(events: Events, truth: PixelTruth) -> Events:
    """Events that lie on the edge of the true ball at the time of the light that they are of."""
    at = truth.at(events.t_us - SENSOR_DELAY_US)
    distance = np.hypot(events.x_px - at.u_px, events.y_px - at.v_px)
    return events.rows(np.nan_to_num(np.abs(distance - at.r_px), nan=np.inf) <= RIM_PX)


def read_time_ns(events: Events) -> float:
    """Processor time per event of a compiled pass that looks at every column once; the best of some passes."""
    if not len(events):
        return math.nan
    read_once(events.t_us[:1], events.x_px[:1], events.y_px[:1], events.on[:1])  # compiles
    best_s = math.inf
    for _ in range(READS):
        began_s = time.thread_time()
        read_once(events.t_us, events.x_px, events.y_px, events.on)
        best_s = min(best_s, time.thread_time() - began_s)
    return 1e9 * best_s / len(events)


@njit
def read_once(t_us, x_px, y_px, on):
    """A number that every event has a part in."""
    total = 0
    for k in range(len(t_us)):
        total += t_us[k] ^ (x_px[k] + 2 * y_px[k] + on[k])
    return total


WARM_UP_US: Final = 100_000
COMMON_US: Final = math.lcm(*(method_config(method).window.window_us for method in METHODS))
"""Every method has a window that ends at whole multiples of it."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedRecording:
    """A simulated recording with its events in memory."""

    scene: str
    seed: int
    name: str
    file: FileRecording
    cameras: dict[str, LoadedCamera]
    calibrations: dict[str, Camera]
    ball: BallTruth


def load_recording(file: FileRecording, *, scene: str, seed: int, name: str) -> LoadedRecording:
    """Read all of it but the frames.

    Raises:
        CalibrationError: if a camera has no calibration.
    """
    ball = file.ball
    assert ball is not None, "simulated recordings know where the ball is"
    cameras = {camera: load_camera(stream) for camera, stream in file.cameras.items()}
    return LoadedRecording(scene, seed, name, file, cameras, calibrated_cameras(file), ball)


def measure_method(recording: LoadedRecording, method: Method) -> PerceptionResult:
    """The detector alone on every camera, then the whole chain."""
    config, chain = method_config(method), chain_of(method)
    window_us = config.window.window_us
    score, seconds, windows, events = GridScore(), [], 0, 0
    recovery: list[float | None] = []
    bounds: list[CircleBounds] = []
    shown: list[ShownAnswer | None] = []
    delays: list[int] = []
    in_time: list[InTimeErrors] = []
    end_us = shown_window(recording)
    with one_thread():
        for camera in recording.cameras.values():
            _warm_up(camera, method)
            detector = TimedDetector(make_detector(method, camera.sensor))
            stamped = run_detector(camera, detector, window_us)
            delays.append(find_delay_us(stamped, camera.truth, camera.sensor))
            answers = without_delay(stamped, delays[-1])
            arrival_us = arrival_times(answers.end_us, 1e6 * np.array(detector.seconds))
            in_time.append(errors_in_time(answers, camera.truth, arrival_us, asked_times(answers)))
            score += score_on_grid(answers, camera.truth, camera.sensor, ANY_SPEED, window_us=window_us)
            seconds.append(np.array(detector.seconds)[answers.detected])
            windows += len(answers.end_us)
            events += len(camera.slice(0, window_us * len(answers.end_us)))
            recovery += recovery_times_ms(answers, camera.truth)
            bounds += circle_bounds(camera, method, config)
            shown.append(answer_at(answers, end_us))
        mean_us = round(float(np.mean(delays)))
        space = space_errors(recording.cameras, recording.calibrations, recording.ball, chain, mean_us)
    return PerceptionResult(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        method=method,
        window_us=window_us,
        windows=windows,
        asked=score.asked,
        found=score.found,
        answers=score.answers,
        false=score.false,
        error_px=rounded(score.error_px),
        events=events,
        cpu_ms=rounded(1e3 * np.concatenate(seconds)),
        recovery_ms=tuple(recovery),
        bound_px=rounded([bound.events_px for bound in bounds]),
        pixel_bound_px=rounded([bound.pixels_px for bound in bounds]),
        point_mm=rounded(space.point_mm),
        points_without_ball=space.points_without_ball,
        hits=space.hits,
        hit_mm=rounded(space.hit_mm),
        shown=shown[0],
        delay_us=tuple(delays),
        age_ms=known_values([1e-3 * one.age_us for one in in_time]),
        held_px=known_values([one.held_px for one in in_time]),
        moved_px=known_values([one.moved_px for one in in_time]),
    )


def known_values(columns: Sequence[Array]) -> tuple[float, ...]:
    """All values of some columns but nan, rounded for the result file."""
    together = np.concatenate(columns)
    return rounded(together[np.isfinite(together)])


def read_recording(recording: LoadedRecording) -> RecordingReading:
    """What frames there are, and what reading the events once costs."""
    frames = {name: stream for name, stream in recording.file.frames.items() if len(stream)}
    with_ball = sum(int(recording.cameras[name].truth.at(one.t_us).visible.sum()) for name, one in frames.items())
    one = next(iter(frames.values()), None)
    return RecordingReading(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        seconds=sum(1e-3 * len(camera.counts_per_ms()) for camera in recording.cameras.values()),
        events=sum(camera.event_count for camera in recording.cameras.values()),
        frames=sum(len(stream) for stream in frames.values()),
        frames_with_ball=with_ball,
        frame_bytes=0 if one is None else one.image(0).nbytes,
        frame_period_us=0 if one is None or len(one) < 2 else round(float(np.median(np.diff(one.t_us)))),
        exposure_us=0 if one is None else int(one.exposure_us[0]),
        read_ns=round(min(read_time_ns(camera.events) for camera in recording.cameras.values()), 3),
        shown_us=shown_window(recording),
    )


def shown_window(recording: LoadedRecording) -> int | None:
    """End of the window that is drawn: in the middle of those with the whole ball in the first camera's picture."""
    camera = next(iter(recording.cameras.values()))
    ends_us = np.arange(COMMON_US, 1000 * len(camera.counts_per_ms()) + 1, COMMON_US)
    ends_us = ends_us[wholly_in_view(camera.truth.at(ends_us), camera.sensor)]
    return int(ends_us[len(ends_us) // 2]) if len(ends_us) else None


def answer_at(answers: WindowAnswers, end_us: int | None) -> ShownAnswer | None:
    """What was said of the window that ends then; None if nothing, or if it is not known when."""
    if end_us is None:
        return None
    for row in np.flatnonzero(answers.detected & (answers.end_us == end_us)).tolist():
        place = (round(float(column[row]), 3) for column in (answers.u_px, answers.v_px, answers.r_px))
        u_px, v_px, r_px = place
        return ShownAnswer(t_us=int(answers.t_us[row]), u_px=u_px, v_px=v_px, r_px=r_px)
    return None


def _warm_up(camera: LoadedCamera, method: Method) -> None:
    """Compile and load what the method needs, on windows with the ball: that is no part of a step."""
    visible = camera.truth.t_us[camera.truth.visible]
    start_us = int(visible[0]) if len(visible) else 0
    detector, window_us = make_detector(method, camera.sensor), method_config(method).window.window_us
    for window in windows_between(camera, start_us, start_us + WARM_UP_US, window_us):
        detector.step(window)


@contextmanager
def one_thread() -> Iterator[None]:
    """What OpenCV computes in threads of its own would not be counted."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


METHOD: Final = "yolo"
WARM_UP: Final = 2
"""Pictures before the first that counts."""
STAMP_DIGITS: Final = 10
"""Of a stamp."""


def weights_stamp(path: Path | None = None) -> str | None:
    """What tells these weights from others, by default those that come with the package; None if there are none."""
    path = path or SHIPPED
    return hashlib.sha256(path.read_bytes()).hexdigest()[:STAMP_DIGITS] if path.is_file() else None


def measure_frames(recording: LoadedRecording, path: Path | None = None) -> PerceptionResult | None:
    """The detector on the pictures of every camera, on one thread; None if the recording has no pictures.

    A picture counts for half a period to both sides, as a window of events does for half its length.

    Raises:
        ConfigError: if the weights cannot be used.
    """
    streams = {name: one for name, one in recording.file.frames.items() if len(one) > 1}
    if not streams:
        return None
    weights = load_weights(path or SHIPPED)
    score, seconds, recovery = GridScore(), [], []
    delays: list[int] = []
    in_time: list[InTimeErrors] = []
    period_us = round(float(np.median(np.concatenate([np.diff(one.t_us) for one in streams.values()]))))
    with one_thread(), one_torch_thread():
        for name, frames in streams.items():
            camera = recording.cameras[name]
            detector = TimedDetector(_warm(weights, frames))
            stamped = run_on_frames(frames, detector)
            delays.append(find_delay_us(stamped, camera.truth, camera.sensor))
            answers = without_delay(stamped, delays[-1])
            arrival_us = arrival_times(answers.end_us, 1e6 * np.array(detector.seconds))
            in_time.append(errors_in_time(answers, camera.truth, arrival_us, asked_times(answers)))
            score += score_on_grid(answers, camera.truth, camera.sensor, ANY_SPEED, window_us=period_us)
            seconds.append(np.array(detector.seconds)[answers.detected])
            recovery += recovery_times_ms(answers, camera.truth)
    first, count = next(iter(streams.values())), sum(len(one) for one in streams.values())
    return PerceptionResult(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        method=METHOD,
        window_us=period_us,
        windows=count,
        asked=score.asked,
        found=score.found,
        answers=score.answers,
        false=score.false,
        error_px=rounded(score.error_px),
        events=0,
        cpu_ms=rounded(1e3 * np.concatenate(seconds)),
        recovery_ms=tuple(recovery),
        bound_px=(),
        pixel_bound_px=(),
        point_mm=(),
        points_without_ball=0,
        hits=0,
        hit_mm=(),
        shown=None,
        frame_bytes=count * first.image(0).nbytes,
        exposure_us=int(first.exposure_us[0]),
        sharp_recall=None if weights.score is None else weights.score.recall,
        delay_us=tuple(delays),
        age_ms=known_values([1e-3 * one.age_us for one in in_time]),
        held_px=known_values([one.held_px for one in in_time]),
        moved_px=known_values([one.moved_px for one in in_time]),
    )


def _warm(weights: YoloWeights, frames: FrameStream) -> YoloDetector:
    """A detector that has seen some pictures: what it loads and allocates first is no part of a step."""
    detector = YoloDetector(weights)
    for _, window in zip(range(WARM_UP), frame_windows(frames), strict=False):
        detector.step(window)
    return detector
