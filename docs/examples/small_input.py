"""The recording that the examples work on: the file named on the command line, or a simulated serve."""

import atexit
import shutil
import sys
import tempfile
from pathlib import Path

from core.cameras import stereo_preset
from core.simulation import LaunchConfig, StereoConfig, simulate_recording


def recording_path() -> Path:
    """The first argument, or a serve at 5 m/s before two cameras in a folder that goes when the script ends."""
    if len(sys.argv) > 1:
        return Path(sys.argv[1])
    folder = Path(tempfile.mkdtemp(prefix="rallyscope-example-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    serves = [LaunchConfig(speed_mps=5.0)]
    return simulate_recording(folder / "serve.h5", StereoConfig(), stereo_preset(), serves, seed=7).path
