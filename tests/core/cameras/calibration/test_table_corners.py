from pathlib import Path

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.cameras.calibration.table_corners import CORNERS, Clicks, pose_from_clicks, read_clicks
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
CAMERA = stereo_preset("behind")["left"]


def clicked(*names: str, noise_px: float = 0.0) -> Clicks:
    uvs = CAMERA.project(np.array([CORNERS[name] for name in names]))
    return Clicks(names, uvs + np.random.default_rng(0).normal(0, noise_px, uvs.shape))


FLAT = ("robot-right", "opponent-left", "opponent-right", "net-left", "net-right")


@pytest.mark.parametrize("names", [FLAT, FLAT[:4], (*FLAT, "post-left", "post-right")])
def test_the_camera_is_found_where_it_stands(names: tuple[str, ...]) -> None:
    found = pose_from_clicks(CAMERA, clicked(*names), "left")
    np.testing.assert_allclose(found, CAMERA.T_world_camera, atol=1e-5)


def test_of_the_two_poses_that_fit_a_flat_table_the_one_above_it_is_taken() -> None:
    for seed in range(5):
        uvs = clicked(*FLAT).uvs_px + np.random.default_rng(seed).normal(0, 1.0, (5, 2))
        found = pose_from_clicks(CAMERA, Clicks(FLAT, uvs), "left")
        assert found[2, 3] > 0 and np.linalg.norm(found[:3, 3] - CAMERA.position_world_m) < 0.1


def test_a_table_of_clicks_is_read_per_camera(tmp_path: Path) -> None:
    path = tmp_path / "corners.csv"
    path.write_text("camera,corner,u_px,v_px\nleft,net-left,1.5,2\nright,net-left,3,4\nleft,post-right,5,6\n")
    found = read_clicks(path)
    assert found["left"].names == ("net-left", "post-right") and found["right"].uvs_px.tolist() == [[3, 4]]
    np.testing.assert_allclose(found["left"].ps_world_m, [[0, 0.7625, 0], [0, -0.915, 0.1525]])


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("left,corner-1,1,2", "no such corner; expected robot-left"),
        ("left,net-left,1,x", "not a pixel"),
        ("left,net-left,1,nan", "finite"),
        ("left,net-left,1,2\nleft,net-left,1,2", "twice"),
        ("left", "not a clicked corner"),
    ],
)
def test_what_is_no_click_is_refused_with_its_line(tmp_path: Path, rows: str, says: str) -> None:
    path = tmp_path / "corners.csv"
    path.write_text(f"camera,corner,u_px,v_px\n{rows}\n")
    with pytest.raises(CalibrationError, match=rf"corners.csv, line {len(rows.splitlines()) + 1}: .*{says}"):
        read_clicks(path)


def test_three_clicks_are_too_few() -> None:
    with pytest.raises(CalibrationError, match="expected 4 or more, got 3"):
        pose_from_clicks(CAMERA, clicked(*FLAT[:3]), "left")
