"""`rallyscope calibrate rig`: the files it reads, the rig it writes, and a camera that it cannot place."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from benchmarks.calibration.bench_rig import BallSwing, pose_errors, ring, seen_by
from core.cameras import load_calibration, save_calibration

pytestmark = pytest.mark.numeric
CAMERAS = ring(4)
SWING = BallSwing(2.5, middle_m=(0.0, 0.0, 0.4), reach_m=(0.9, 0.6, 0.3))


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One table of a ball swung before four cameras, with 0.2 px of noise, and lenses without poses."""
    folder = tmp_path_factory.mktemp("sweep")
    rng = np.random.default_rng(0)
    with (folder / "points.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["camera", "time", "x", "y"])
        for name, camera in CAMERAS.items():
            track = seen_by(camera, SWING, rng, noise_px=0.2, every_us=4000)
            writer.writerows([name, 1e-6 * t, *uv] for t, uv in zip(track.t_us, track.uvs_px.tolist(), strict=True))
            save_calibration(folder / f"{name}.toml", {name: replace(camera, T_world_camera=np.eye(4))})
    return folder


def calibrate(folder: Path, points: str, *more: str) -> int:
    lenses = ",".join(f"{name}={folder}/{name}.toml" for name in CAMERAS)
    given = ["--points", f"{folder}/{points}", "--lenses", lenses, "--same-clock", "--instants", "250"]
    baseline_m = np.linalg.norm(CAMERAS["cam1"].position_world_m - CAMERAS["cam0"].position_world_m)
    return main(["calibrate", "rig", *given, "--scale", f"baseline={baseline_m}", "--out", f"{folder}/rig.toml", *more])


@pytest.mark.gate
def test_a_ball_swept_before_four_cameras_gives_their_poses(sweep: Path, capsys) -> None:
    assert calibrate(sweep, "points.csv", "--json", "--report", str(sweep / "rig.svg")) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["sigma_px"] == pytest.approx(0.2, rel=0.1)
    assert [row["camera"] for row in figures["cameras"]] == list(CAMERAS)
    assert all(row["sigma_position_mm"] < 1.0 and row["points"] > 100 for row in figures["cameras"])
    assert len(figures["covariance"]) == len(figures["parameters"])
    found = load_calibration(sweep / "rig.toml")
    places_mm, turned_deg = pose_errors(list(found.values()), list(CAMERAS.values()))[:, :2].T
    assert places_mm.max() < 1.0 and turned_deg.max() < 0.05
    assert (sweep / "rig.svg").read_text().endswith("</svg>")


def test_a_camera_that_shares_nothing_is_named_with_what_to_sweep(sweep: Path, capsys) -> None:
    rows = (sweep / "points.csv").read_text().splitlines(keepends=True)
    few = [row for row in rows if not row.startswith("cam3")] + [row for row in rows if row.startswith("cam3")][:10]
    (sweep / "few.csv").write_text("".join(few))
    assert calibrate(sweep, "few.csv") == 2
    message = capsys.readouterr().err
    assert "cam3 shares too little" in message and "sweep the ball where cam3 and" in message
    assert message.count("\n") == 1


def test_a_camera_without_a_lens_is_named_with_what_to_do(sweep: Path, capsys) -> None:
    assert main(["calibrate", "rig", "--points", f"{sweep}/points.csv", "--scale", "gravity", "--out", "rig.toml"]) == 2
    message = capsys.readouterr().err
    assert "no lens of cam0" in message and "calibrate intrinsics" in message
