"""Follows the ball, predicts where it will be hit: `python docs/examples/triangulate_and_predict.py [RECORDING]`."""

import numpy as np
from small_input import recording_path

from core.chain import ChainConfig, follow_recording, true_positions
from core.recordings import open_recording
from core.trajectory import FilterPredictor, filter_for

SEEN_US = 250_000
"""How much of the flight the predictor is shown."""

with open_recording(recording_path()) as recording:
    track = follow_recording(recording, ChainConfig(), window_us=2000)
    truth = recording.ball

print(f"{len(track.t_us)} points in space, median residual {np.median(track.residuals_px):.2f} px")
if truth is not None:
    errors_mm = 1e3 * np.linalg.norm(track.ps_world_m - true_positions(truth, track.t_us), axis=1)
    print(f"median error {np.nanmedian(errors_mm):.1f} mm")

predictor = FilterPredictor(filter_for("paper"))
for t_us, p_world_m in zip(track.t_us.tolist(), track.ps_world_m, strict=True):
    if t_us < track.t_us[0] + SEEN_US:
        predictor.add(t_us, p_world_m)
prediction = predictor.predict()
if prediction is None or prediction.hit_plane is None:
    print("the ball does not come to the hitting plane")
else:
    plane = prediction.hit_plane
    x, y, z = plane.p_world_m
    print(f"predicted at {prediction.t_us} us: at x {x:.2f} m in {1e3 * plane.t_s - 1e-3 * prediction.t_us:.0f} ms")
    print(f"y {y:.3f} m +- {plane.sigma_m[1]:.3f}, z {z:.3f} m +- {plane.sigma_m[2]:.3f}")
