"""The chain: the windows of all cameras -> detections -> one point in space -> the prediction of its flight.

One object for the live rally, recordings and learning; it knows nothing of where the windows come from. The newest
detections of all cameras are brought to one time first: a difference in time would go straight into the depth. Points
that are not of the flight that is watched are dropped; new flights and returns are noticed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, StereoRig, TriangulatedPoint
from core.chain.config import ChainConfig
from core.chain.single_view import BallPoint, SingleView
from core.chain.size_check import SizeCheck
from core.chain.time_aligner import AlignedPixels, TimeAligner
from core.chain.track_gate import TrackGate, Verdict
from core.detection import Detection, Detector, TrackState, make_detector
from core.detection.methods import states_of
from core.errors import RecordingError
from core.events import Window
from core.trajectory import FilterPredictor, Prediction
from core.trajectory.learned_constants import LearnedConstants


@dataclass(frozen=True, slots=True)
class StageSeconds:
    """Wall time of the stages of one step."""

    detect: float
    """All cameras together."""
    triangulate: float
    predict: float

    @property
    def total(self) -> float:
        """The whole step."""
        return self.detect + self.triangulate + self.predict


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """What is known after one step."""

    t_us: int
    """Latest end of the windows."""
    detections: dict[str, Detection | None]
    """By camera, of this step's windows."""
    point: BallPoint | None
    """This step's point: the rays met and the point passed the gate."""
    verdict: Verdict | None
    """How the point stands to the flight; None without rays that meet."""
    prediction: Prediction | None
    """The newest of this flight, maybe of an earlier step; None before there is one and after the ball was struck."""
    is_new: bool
    """Whether the prediction was made in this step."""
    bounces_us: tuple[int, ...]
    """Bounces seen in this flight."""
    seconds: StageSeconds
    pixels: AlignedPixels | None = None
    """What the cameras saw at their common time, also where the rays missed each other; None where it was no ball by
    its size."""
    single: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Pixels of cameras that saw the ball at no other camera's time and moved the flight in this step, by camera."""
    predicted_from: tuple[str, ...] = ()
    """The cameras of `prediction`, in the rig's order: all `used` since the one before, or since the flight began."""

    @property
    def used(self) -> frozenset[str]:
        """The cameras that tell where the ball is: those of the point, and those that moved the flight."""
        placed = () if self.point is None else self.point.uvs_px
        return frozenset((*placed, *self.single))


class RallyChain:
    """Follows one ball with two or more calibrated cameras."""

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        config: ChainConfig | None = None,
        frame_detectors: Mapping[str, Detector] | None = None,
    ) -> None:
        """A chain that expects a new ball.

        Args:
            cameras: by name, event cameras and frame cameras.
            config: of all stages.
            frame_detectors: of the frame cameras, whose windows have pictures. Their answers are at times of their
                own: those of three cameras or more move the flight.

        Raises:
            CalibrationError: if the cameras cannot see depth.
        """
        self.config = config or ChainConfig()
        of_frames = frame_detectors or {}
        self.rig = StereoRig(cameras, self.config.triangulation)
        self._detectors: dict[str, Detector] = {
            name: of_frames.get(name) or make_detector(self.config.method, camera.sensor, self.config.detector)
            for name, camera in cameras.items()
        }
        self._common_time = TimeAligner(self.rig.names, round(1000 * self.config.max_lag_ms))
        checked = self.config.size.enabled and self.config.method != "paper"
        self._size = SizeCheck(dict(cameras), self.rig, self.config.size) if checked else None
        self._gate = TrackGate(self.config.flight)
        self._used: set[str] = set()  # since the newest prediction
        self._predicted_from: tuple[str, ...] = ()
        self._predictor = self.config.make_predictor()
        enough = len(cameras) >= self.config.single_view.least_cameras
        self._single: SingleView | None = None
        if enough and isinstance(self._predictor, FilterPredictor):
            self._single = SingleView(cameras, self.rig, self.config, self._predictor, self._size)
        self._distrusted: tuple[str | None, float] = (None, 0.0)

    def reset(self) -> None:
        """Forget everything: the regions of interest too, and what was learnt of air and table."""
        for detector in self._detectors.values():
            detector.reset()
        self._common_time.reset()
        if self._size is not None:
            self._size.reset()
        self.forget_flight()
        self._predictor.reset()
        self.distrust(None)

    def distrust(self, camera: str | None, off_px: float = 0.0) -> None:
        """Weigh a camera's pixels from now on as if its picture were off by `off_px` along each axis; None: no camera.

        The camera is used: what it alone sees beside one other is better than nothing, and its points then have the
        covariance that they deserve.
        """
        self._distrusted = camera, off_px
        if self._single is not None:
            self._single.distrusted = self._distrusted

    @property
    def learned(self) -> LearnedConstants | None:
        """Constants of air and table learned from the balls so far; None where they are known or not learned."""
        learning = self._learning
        return None if learning is None else learning.learned

    @property
    def air(self) -> float:
        """Probability that there is air, by the present flight too; certain where the constants are not learned."""
        learning = self._learning
        return 1.0 if learning is None else learning.air

    @property
    def _learning(self) -> FilterPredictor | None:
        predictor = self._predictor
        return predictor if isinstance(predictor, FilterPredictor) and self.config.filter.perhaps_real else None

    def forget_flight(self) -> None:
        """Expect a new ball; the detectors go on as they are, and what was learnt of air and table is kept."""
        self._gate.reset()
        self._used.clear()
        self._predictor.forget_flight()
        if self._single is not None:
            self._single.forget_flight()

    def track_states(self) -> dict[str, TrackState]:
        """What each detector remembers now: with it the readable pipeline can show the next window's stages."""
        return states_of(self._detectors)

    def step(self, windows: Mapping[str, Window]) -> ChainState:
        """Take the next window of each camera (or of some of them), in order of time.

        Raises:
            RecordingError: for a camera that the chain does not have.
        """
        if not windows or not windows.keys() <= self._detectors.keys():
            expected = f"some of {', '.join(self._detectors)}"
            got = ", ".join(windows) or "none"
            raise RecordingError("windows of other cameras", expected=expected, got=got, where="RallyChain.step")
        started = time.perf_counter()
        detections = {name: self._detectors[name].step(window) for name, window in windows.items()}
        detected = time.perf_counter()
        point, pixels = self._triangulate(detections, windows)
        triangulated = time.perf_counter()
        lone = self._common_time.take_lone()
        if self._single is not None:
            pictures = {name: window for name, window in windows.items() if window.frame is not None}
            self._single.exposures_us |= {name: one.end_us - one.start_us for name, one in pictures.items()}
            alone = self._single.follow(lone)
            # A point of two cameras counts before that of one, whose depth comes from the flight alone.
            point = point or alone
        verdict = None if point is None else self._gate.judge(point.t_us, point.p_world_m)
        fresh = self._follow(point, verdict)
        if fresh is not None:
            self._predicted_from = tuple(name for name in self.rig.names if name in self._used)
            self._used.clear()
        seconds = StageSeconds(detected - started, triangulated - detected, time.perf_counter() - triangulated)
        return ChainState(
            t_us=max(window.end_us for window in windows.values()),
            detections=detections,
            point=None if verdict == "stray" else point,
            verdict=verdict,
            prediction=self._predictor.latest,
            is_new=fresh is not None,
            bounces_us=self._predictor.bounces_us,
            seconds=seconds,
            pixels=pixels,
            single={} if self._single is None else self._single.used,
            predicted_from=() if self._predictor.latest is None else self._predicted_from,
        )

    def _triangulate(
        self, detections: dict[str, Detection | None], windows: Mapping[str, Window]
    ) -> tuple[BallPoint | None, AlignedPixels | None]:
        """The point of the cameras' common time; a circle that is no ball is replaced in `detections` or dropped."""
        together = self._common_time.add(detections)
        if together is None:
            return None, None
        t_us, uvs, covariances = together
        if self._distrusted[0] is not None:
            row, covariances = self.rig.names.index(self._distrusted[0]), covariances.copy()
            if np.isnan(covariances[row]).any():  # as the triangulation reads it
                covariances[row] = self.config.triangulation.sigma_px**2 * np.eye(2)
            covariances[row] += self._distrusted[1] ** 2 * np.eye(2)
        # Without a point the detections go back: each may still be the ball, seen by one camera alone.
        found = self.rig.triangulate_one(uvs, covariances)
        if found is None:
            self._common_time.put_back()
            return None, together
        if self._size is not None:
            radii = {
                name: one.r_px
                for name, one in detections.items()
                if one is not None and one.t_us == t_us and name in found.cameras
            }
            wrong = self._size.wrong(found.p_world_m, radii)
            if wrong:
                found = self._correct(wrong, uvs, radii, detections, windows)
            else:
                self._size.reset()
        if found is None:
            self._common_time.put_back()
            return None, None
        pixels = {
            name: (float(u), float(v))
            for name, (u, v) in zip(self.rig.names, uvs, strict=True)
            if name in found.cameras
        }
        return BallPoint(t_us, found.p_world_m, found.residual_px, found.covariance_m2, pixels), together

    def _correct(
        self,
        wrong: list[str],
        uvs: NDArray[np.float64],
        radii: Mapping[str, float],
        detections: dict[str, Detection | None],
        windows: Mapping[str, Window],
    ) -> TriangulatedPoint | None:
        """The point after a second look into the cameras with wrong circles, or into all; None if there is no ball."""
        assert self._size is not None
        everyone = [name for name in radii if name in windows]
        for names in (wrong, everyone)[: 1 if len(wrong) == len(everyone) else 2]:
            again = self._size.look_again(names, windows, self._detectors, uvs, radii)
            if again is not None:
                for name, found in again[0].items():
                    detections[name] = found
                    uvs[self.rig.names.index(name)] = found.u_px, found.v_px
                    self._common_time.replace(name, found)
                return again[1]
        self._size.give_up(wrong, self._detectors)
        return None

    def _follow(self, point: BallPoint | None, verdict: Verdict | None) -> Prediction | None:
        """Feed the predictor; without a point, a flight that has ended is forgotten at the next one."""
        if self._single is not None:
            self._used.update(self._single.used)
        if point is None or verdict == "stray":
            return None
        if verdict != "same flight":
            self._predictor.forget_flight()
            self._used.clear()
        if verdict == "struck":
            return None
        self._used.update(point.uvs_px)
        if self._single is not None:
            if len(point.uvs_px) == 1:  # the predictor has it
                return self._single.predictor.predict_if_due()
            self._single.note_several(point.t_us)
            if point.t_us <= self._single.predictor.newest_us:  # a single camera was ahead
                return None
        return self._predictor.add(point.t_us, point.p_world_m, point.covariance_m2)
