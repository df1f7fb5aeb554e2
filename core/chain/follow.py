"""The chain over a whole recording: the ball's track as columns, and how far it is from the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.chain.calibration_drift import CalibrationDrift, DriftReport
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.detection import Detector
from core.detection.window import windows_side_by_side
from core.errors import CalibrationError
from core.events import Window
from core.recordings import BallTruth, CameraStream, Recording
from core.recordings.frames import FrameStream, frames_of, window_of
from core.recordings.reader import FileRecording

Array = NDArray[np.float64]
REPORT_EVERY = 64
"""Windows between two reports of progress."""
TRUTH_GAP_US = 5000
"""The truth is not read across a longer gap between its samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The points of the ball that the chain accepted."""

    t_us: NDArray[np.int64]
    ps_world_m: Array
    """(N, 3)."""
    residuals_px: Array
    """(N,)."""
    windows: int
    seen_by_all: int
    """Windows in which every camera found a ball; a frame camera counts in those in which its exposure ended."""
    step_s: Array
    """(windows,) wall time of the chain's steps."""
    cameras: tuple[tuple[str, ...], ...] = ()
    """For each point, the cameras that it is made of."""
    single: dict[str, int] = field(default_factory=dict)
    """How often a camera saw the ball at no other camera's time and moved the flight, by camera."""
    drift: DriftReport = field(default_factory=DriftReport)
    """Whether the calibration fits these points."""


def calibrated_cameras(recording: Recording) -> dict[str, Camera]:
    """The cameras of a recording that can be triangulated.

    Raises:
        CalibrationError: if one has no calibration.
    """
    cameras: dict[str, Camera] = {}
    for name, stream in recording.cameras.items():
        if stream.calibration is None:
            remedy = "import the recording with --calibration FILE"
            raise CalibrationError("no calibration", where=f"camera {name}", remedy=remedy)
        cameras[name] = stream.calibration
    return cameras


def frame_cameras(recording: Recording) -> dict[str, FrameStream]:
    """The calibrated cameras of a recording that have pictures and no events; of a live one before the first, too."""
    events, is_whole = recording.cameras, isinstance(recording, FileRecording)
    known = {name: one for name, one in frames_of(recording).items() if one.calibration is not None}
    return {name: one for name, one in known.items() if name not in events and (len(one) or not is_whole)}


def calibrated_rig(recording: Recording) -> dict[str, Camera]:
    """All cameras of a recording that can be triangulated, the event cameras first.

    Raises:
        CalibrationError: if an event camera has no calibration.
    """
    frames = {name: one.calibration for name, one in frame_cameras(recording).items() if one.calibration is not None}
    return calibrated_cameras(recording) | frames


def windows_with_frames(
    streams: Mapping[str, CameraStream], frames: Mapping[str, FrameStream], end_us: int, window_us: int
) -> Iterator[dict[str, Window]]:
    """Windows of event cameras side by side, with pictures as `add_pictures` says.

    Args:
        streams: event cameras, by name.
        frames: frame cameras, by name.
        end_us: no window ends later.
        window_us: length of each.
    """
    return add_pictures(windows_side_by_side(streams, 0, end_us, window_us), frames)


def add_pictures(
    side_by_side: Iterable[dict[str, Window]], frames: Mapping[str, FrameStream]
) -> Iterator[dict[str, Window]]:
    """The windows of event cameras, with the newest picture of each frame camera whose exposure ended in them.

    So a chain gets a picture when a camera could have sent it, not when its exposure began.
    """
    for windows in side_by_side:
        of_events = next(iter(windows.values()))
        for name, one in frames.items():
            ended = one.ending_within(of_events.start_us, of_events.end_us)
            if ended:
                windows[name] = window_of(one.frame(ended[-1]))
        yield windows


def follow_recording(
    recording: Recording,
    config: ChainConfig,
    window_us: int,
    *,
    only: Collection[str] | None = None,
    frame_detector: Callable[[], Detector] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Track:
    """The track of the ball through a recording, all cameras window by window, or `only` some.

    Args:
        recording: with a calibration of each camera.
        config: detector, gate, prediction and control.
        window_us: length of a window.
        only: names of the cameras that are used; None: all.
        frame_detector: makes the detector of each calibrated frame camera; None: those are left out.
        progress: gets the share of the recording that is done.

    Raises:
        CalibrationError: if there are fewer than two cameras, or one has no calibration.
    """
    cameras = calibrated_cameras(recording) if frame_detector is None else calibrated_rig(recording)
    chosen = {name: camera for name, camera in cameras.items() if only is None or name in only}
    streams = {name: stream for name, stream in recording.cameras.items() if name in chosen}
    frames = {name: one for name, one in frame_cameras(recording).items() if name in chosen}
    of_frames = {} if frame_detector is None else {name: frame_detector() for name in frames}
    chain, drift = RallyChain(chosen, config, of_frames), CalibrationDrift(chosen)
    side_by_side = windows_with_frames(streams, frames, recording.duration_us, window_us)
    times: list[int] = []
    rows: list[tuple[float, float, float, float]] = []
    used: list[tuple[str, ...]] = []
    seconds: list[float] = []
    seen_by_all = 0
    single: Counter[str] = Counter()
    for number, windows in enumerate(side_by_side):
        state = chain.step(windows)
        chain.distrust(*drift.add(state).distrusted)
        seconds.append(state.seconds.total)
        seen_by_all += all(found is not None for found in state.detections.values())
        single.update(state.single.keys())
        if state.point is not None:
            x, y, z = state.point.p_world_m.tolist()
            times.append(state.point.t_us)
            rows.append((x, y, z, state.point.residual_px))
            used.append(tuple(state.point.uvs_px))
        if number % REPORT_EVERY == 0:
            progress(state.t_us / recording.duration_us)
    columns = np.array(rows, np.float64).reshape(-1, 4)
    return Track(
        t_us=np.array(times, np.int64),
        ps_world_m=columns[:, :3],
        residuals_px=columns[:, 3],
        windows=len(seconds),
        seen_by_all=seen_by_all,
        step_s=np.array(seconds),
        cameras=tuple(used),
        single=dict(single),
        drift=drift.report,
    )


def true_positions(truth: BallTruth, t_us: ArrayLike) -> Array:
    """Where the ball really was (N, 3), linear between samples; nan where there was none or nobody knows."""
    t = np.atleast_1d(np.asarray(t_us, np.int64))
    if not len(truth.t_us):
        return np.full((len(t), 3), np.nan)
    after = np.clip(np.searchsorted(truth.t_us, t, side="left"), 0, len(truth.t_us) - 1)
    before = np.where(truth.t_us[after] == t, after, np.maximum(after - 1, 0))
    span = truth.t_us[after] - truth.t_us[before]
    share = (t - truth.t_us[before]) / np.maximum(span, 1)
    found = truth.p_world_m[before] + share[:, None] * (truth.p_world_m[after] - truth.p_world_m[before])
    known = (truth.t_us[0] <= t) & (t <= truth.t_us[-1]) & (span <= TRUTH_GAP_US)
    found[~(known & truth.visible[before] & truth.visible[after])] = np.nan
    return found
