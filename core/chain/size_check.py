"""A circle must have the size of a ball at the depth at which the rays meet; one that has not is something else.

After a bounce the ball's shadow is as round as the ball and nearer to the middle of the region of interest, and a
detector that has changed over to it stays there. Shadow and ball differ in size: on simulated serves 99.5 % of the true
circles have 0.8 to 1.6 times the expected radius, 99.7 % of the false ones less than 0.75.

For limits so wide the radius on the axis at the same depth will do; `core.cameras.outline` has the exact one.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, StereoRig, TriangulatedPoint
from core.chain.config import SizeCheckConfig
from core.detection import Detection, Detector, FastDetector, TrackState, trace_window
from core.detection.fast.cluster import grid_labels
from core.events import Window
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]


class SizeCheck:
    """Compares radii with depths, and looks again where they do not agree."""

    def __init__(self, cameras: Mapping[str, Camera], rig: StereoRig, config: SizeCheckConfig) -> None:
        self._cameras = cameras
        self._rig = rig
        self._config = config
        self._failures = dict.fromkeys(cameras, 0)

    def reset(self) -> None:
        """Forget the failures."""
        self._failures = dict.fromkeys(self._cameras, 0)

    def wrong(self, p_world_m: Array, radii_px: Mapping[str, float]) -> list[str]:
        """The cameras whose circle cannot be a ball at this point."""
        names = []
        for name, radius in radii_px.items():
            camera = self._cameras[name]
            ratio = radius / _expected_radius_px(camera, p_world_m)
            if not self._config.smallest <= ratio <= self._config.largest:
                names.append(name)
        return names

    def look_again(
        self,
        names: Sequence[str],
        windows: Mapping[str, Window],
        detectors: Mapping[str, Detector],
        uvs_px: Array,
        radii_px: Mapping[str, float],
    ) -> tuple[dict[str, Detection], TriangulatedPoint] | None:
        """Other circles of the cameras `names` that make a ball with what the rest sees, and its point.

        The detectors then go on from them.

        Args:
            names: cameras whose circle has a wrong size.
            windows: the window of every camera.
            detectors: those of the same cameras.
            uvs_px: (C, 2) centres in all cameras, in the rig's order; nan: none.
            radii_px: of the circles that are kept.
        """
        others = [_circles(windows[name], detectors[name]) for name in names]
        best: tuple[dict[str, Detection], TriangulatedPoint] | None = None
        # All cameras in doubt together: the point depends on each of their circles.
        for circles in itertools.product(*others):
            chosen = dict(zip(names, circles, strict=True))
            uvs = uvs_px.copy()
            for name, circle in chosen.items():
                uvs[self._rig.names.index(name)] = circle.u_px, circle.v_px
            point = self._rig.triangulate_one(uvs)
            if point is None or (best is not None and point.residual_px >= best[1].residual_px):
                continue
            if not self.wrong(point.p_world_m, {**radii_px, **{name: one.r_px for name, one in chosen.items()}}):
                best = chosen, point
        if best is None:
            return None
        for name, found in best[0].items():
            detector = detectors[name]
            assert isinstance(detector, FastDetector)
            detector.resume(replace(detector.state, centre_px=(found.u_px, found.v_px), misses=0))
        self.reset()
        return best

    def give_up(self, names: Sequence[str], detectors: Mapping[str, Detector]) -> None:
        """Note that these cameras have no ball; after some windows in a row their whole sensors are searched."""
        for name in names:
            self._failures[name] += 1
            if self._failures[name] >= self._config.patience:
                detectors[name].reset()
                self._failures[name] = 0


def _circles(window: Window, detector: Detector) -> list[Detection]:
    """Every circle near the one that the detector chose that passes its tests; none for other kinds of detectors."""
    if not isinstance(detector, FastDetector):
        return []
    state = detector.state
    around = TrackState(centre_px=state.centre_px, on_leads=state.on_leads)
    trace = trace_window(window, around, detector.config, label_clusters=grid_labels)
    circles = [one.circle for one in trace.candidates if one.rejected is None and one.circle is not None]
    t_us = window.end_us - detector.config.localise.delay_us
    return [Detection(t_us, circle.u_px, circle.v_px, circle.r_px) for circle in circles]


def _expected_radius_px(camera: Camera, p_world_m: Array) -> float:
    """About the radius of a ball at a point in the camera's picture."""
    p_camera = camera.to_camera(p_world_m)[0]
    depth_m = max(float(p_camera[2]), 1e-9)
    pinhole = BALL_RADIUS_M / depth_m
    if camera.model == "pinhole":
        return float(camera.K[0, 0]) * pinhole
    # A sphere's picture is longer away from the axis by 1 / cos; the lens squeezes it again.
    stretch = float(np.linalg.norm(p_camera)) / depth_m
    slopes = camera.pixel_slopes(p_camera[None, :2] / depth_m)[0]
    return pinhole * float(np.sqrt(stretch * np.linalg.det(slopes)))
