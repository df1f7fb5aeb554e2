"""Simulates a scene with two event cameras: `python docs/examples/simulate_scene.py [OUT.h5] [SCENE] [WxH]`."""

import sys
import tempfile
from pathlib import Path

from core.cameras import stereo_preset
from core.events import SensorSize
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording

out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "scene.h5"
scene = scene_named(sys.argv[2] if len(sys.argv) > 2 else "dark")
width_px, height_px = map(int, (sys.argv[3] if len(sys.argv) > 3 else "1280x720").split("x"))

made = simulate_recording(
    out,
    StereoConfig(scene=scene, sensor=SensorConfig(noise_hz=0.5)),
    stereo_preset("side", SensorSize(width_px, height_px)),
    [LaunchConfig(speed_mps=5.0)],
    seed=1,
)
print(f"{made.path}: {made.duration_us / 1e6:.3f} s, the ball is visible {made.truths} times")
for name, count in made.events.items():
    print(f"{name}: {count} events")
