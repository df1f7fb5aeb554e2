"""A small recording that has everything a recording can have."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings import BallTruth, PixelTruth, RecordingWriter, Triggers

ELSEWHERE: Final = "elsewhere.h5"
"""The file beside the damaged one that its links lead to: nothing of it may ever be read."""
SENSOR: Final = SensorSize(96, 72)
DURATION_US: Final = 60_000
EVENTS: Final = {"left": 40_000, "right": 3_000}
"""Two chunks of events, and a part of one."""
Rows = dict[str, NDArray]


def write_sample_recording(path: Path, *, close: bool = True) -> None:
    """Write it; without `close` as the log that a killed writer leaves."""
    rng = np.random.default_rng(5)
    camera = Camera(SENSOR, np.array([[90.0, 0, 47], [0, 90, 35], [0, 0, 1]]), np.zeros(5), np.eye(4))
    cameras = {"left": SENSOR, "right": SENSOR}
    config = {"scene": {"name": "ball"}, "serves": [], "physics": {}}
    writer = RecordingWriter(
        path, cameras, calibration=dict.fromkeys(cameras, camera), seed=7, config=config, uuid="damage-trial"
    )
    writer.note("Made to be damaged.")
    t_us = np.arange(0, DURATION_US, 500)
    seen = t_us < 50_000
    for name, count in EVENTS.items():
        writer.append(name, _events(count, rng))
        u, v, r = (np.where(seen, rng.uniform(5, 60, len(t_us)), np.nan) for _ in range(3))
        writer.write_truth(name, PixelTruth(t_us, u, v, r, seen))
        writer.write_triggers(name, Triggers(t_us[::10], t_us[::10] % 2 == 0, np.zeros(len(t_us[::10]), np.int16)))
        writer.append_rows(f"/readout/{name}", {k: np.array([3]) for k in ("delayed", "dropped", "longest_us")})
    frame_t_us = np.arange(10_000, DURATION_US, 20_000)
    images = rng.integers(0, 256, (len(frame_t_us), 72, 96, 3), np.uint8)
    writer.write_frames("left", frame_t_us, np.full(len(frame_t_us), 4000), images)
    p, v, spin = (rng.normal(0, 1, (len(t_us), 3)) for _ in range(3))
    writer.write_ball(BallTruth(t_us, p, v, spin, seen))
    for group, rows in _rally_rows(rng).items():
        writer.append_rows(group, rows)
    writer.flush()
    if close:
        writer.close()
    else:
        data = path.read_bytes()
        writer.close()
        path.write_bytes(data)


def write_elsewhere(path: Path) -> None:
    """Another person's file, that links of a damaged one lead to: it has every group too, with other values."""
    write_sample_recording(path)
    with h5py.File(path, "r+") as file:
        file.attrs["uuid"] = "not-to-be-read"


def _events(count: int, rng: np.random.Generator) -> Events:
    t_us = np.sort(rng.integers(0, DURATION_US, count))
    x, y = rng.integers(0, SENSOR.width_px, count), rng.integers(0, SENSOR.height_px, count)
    return Events.from_columns(t_us, x, y, rng.random(count) < 0.5, SENSOR)


def _rally_rows(rng: np.random.Generator) -> dict[str, Rows]:
    """What a live rally writes beside its events."""
    t_us = np.arange(0, DURATION_US, 5000)
    n = len(t_us)
    q = np.tile([1.0, 0, 0, 0], (n, 1))
    stage = np.full(n, b"pre", "S4")
    vectors = {key: rng.normal(0, 1, (n, 3)) for key in ("p_world_m", "v_world_mps")}
    hit = {"t_us": t_us, "stage": stage, "t_hit_us": t_us + 9000}
    states = {
        key: rng.normal(0, 1, (n, width)) for key, width in (("s", 6), ("g", 2), ("a", 3), ("f", 3), ("s_next", 6))
    }
    about = {"speed_mps": np.full(n, 5.0), "case": np.arange(n) % 3 + 1, "reward": np.zeros(n)}
    return {
        "/racket": {"t_us": t_us, "q_world_wxyz": q, **vectors},
        "/predictions": hit
        | {"p_hit_m": vectors["p_world_m"], "v_hit_mps": vectors["v_world_mps"], "cov": np.tile(np.eye(6), (n, 1, 1))},
        "/racket_targets": hit | vectors | {"q_world_wxyz": q, "a": states["a"], "g": states["g"]},
        "/episodes": {"serve_us": t_us, **about, **states, "q_wxyz": q, "policy": np.full(n, b"oracle", "S32")},
        "/hit_choices": {
            "t_us": t_us,
            "t_hit_us": t_us + 9000,
            "p_hit_m": vectors["p_world_m"],
            "sigma_m": vectors["p_world_m"] ** 2,
            "chance": np.full(n, 0.5),
            "landing_sigma_m": np.full(n, np.inf),
            "chosen": np.arange(n) % 2 == 0,
            "why_not": np.full(n, b"too low", "S64"),
        },
        "/scenes": {"t_us": t_us[:1], "zero_us": t_us[:1], "seed": t_us[:1], "name": np.array([b"ball"], "S32")},
    }
