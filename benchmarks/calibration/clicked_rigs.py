"""How well the table's corners alone place a pair of cameras, when a person clicks those that are in the pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.calibration.calibration_error import seen_volume, space_errors
from benchmarks.calibration.drifted_rigs import epipolar_rms_px
from benchmarks.calibration.swept_ball import click_corners
from core.cameras import stereo_preset
from core.cameras.calibration.table_calibration import place_at_table

POINTS = 400


def clicked_row(placement: str, click_sigma_px: float, seeds: range) -> dict[str, object]:
    """Medians over the seeds, and the worst twentieth."""
    true = stereo_preset(placement)
    lenses = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in true.items()}
    ps = seen_volume(true, POINTS, np.random.default_rng(0))
    off_mm, said_mm, epipolar_px, space_mm, corners = [], [], [], [], 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        clicks = click_corners(true, rng, click_sigma_px)
        poses = place_at_table(lenses, clicks)
        believed = {name: pose.camera for name, pose in poses.items()}
        corners = min(len(one.names) for one in clicks.values())
        for name, pose in poses.items():
            off_mm.append(1e3 * np.linalg.norm(pose.camera.position_world_m - true[name].position_world_m))
            said_mm.append(1e3 * pose.sigma_m)
        epipolar_px.append(epipolar_rms_px(true, believed, ps))
        space_mm.append(1e3 * np.nanmedian(space_errors(true, believed, ps, 0.0, rng).whole_m))
    row: dict[str, object] = {"placement": placement, "click_px": click_sigma_px, "corners": corners}
    figures = {"camera_mm": off_mm, "said_mm": said_mm, "epipolar_px": epipolar_px, "3d_mm": space_mm}
    for name, values in figures.items():
        row[f"{name}_median"] = round(float(np.median(values)), 2)
        row[f"{name}_p95"] = round(float(np.percentile(values, 95)), 2)
    return row
