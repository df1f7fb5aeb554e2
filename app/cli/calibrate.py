"""`rallyscope calibrate intrinsics|stereo|rig`: lenses from a board, poses and clocks from a sweep."""

from app.cli import calibrate_intrinsics, calibrate_rig, calibrate_stereo

ACTS = {"intrinsics": calibrate_intrinsics.run, "stereo": calibrate_stereo.run, "rig": calibrate_rig.run}
