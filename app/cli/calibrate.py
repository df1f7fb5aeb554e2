"""`rallyscope calibrate intrinsics|stereo`: lenses from pictures of a board, poses and clocks from a swept ball."""

from app.cli import calibrate_intrinsics, calibrate_stereo

ACTS = {"intrinsics": calibrate_intrinsics.run, "stereo": calibrate_stereo.run}
