"""Run before the tests: compile what most of them need, once, while the static checks have the other processor.

Without it both workers of pytest would begin by compiling the same kernels of a fresh clone, a minute or two each.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from app.startup.chain import compile_chain
from core.cameras import stereo_preset
from core.simulation import LaunchConfig, StereoConfig, simulate_recording


def main() -> None:
    """Follow a painted ball, and simulate a serve."""
    compile_chain(lambda ready, known: None)
    with TemporaryDirectory() as folder:
        serve = LaunchConfig(speed_mps=5.0)
        simulate_recording(Path(folder) / "serve.h5", StereoConfig(), stereo_preset(), [serve], seed=7)


if __name__ == "__main__":
    main()
