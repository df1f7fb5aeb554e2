"""Where a camera stands by clicked corners of the table; clicks that say nothing, or nonsense, are refused."""

from dataclasses import replace

import numpy as np
import pytest

from core.cameras import load_calibration, stereo_preset
from core.cameras.calibration.table_corners import CORNERS, Clicks, read_clicks
from core.cameras.calibration.table_pose import clicks_of, find_table_pose, place_at_table, write_table_calibration
from core.cameras.stereo import EpipolarPair
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
PAIR = stereo_preset("behind")
LENSES = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in PAIR.items()}


def clicked(name: str, corners: tuple[str, ...] = tuple(CORNERS), sigma_px: float = 0.0, seed: int = 0) -> Clicks:
    uvs = PAIR[name].project(np.array([CORNERS[corner] for corner in corners]))
    return Clicks(corners, uvs + np.random.default_rng(seed).normal(0, sigma_px, uvs.shape))


TOP = ("robot-left", "robot-right", "opponent-left", "opponent-right")


@pytest.mark.parametrize("corners", [TOP, tuple(CORNERS), (*TOP[:2], "net-left", "post-right")])
def test_exact_clicks_give_the_exact_pose_whatever_pose_the_lens_came_with(corners) -> None:
    found = find_table_pose("left", LENSES["left"], clicked("left", corners))
    np.testing.assert_allclose(found.camera.T_world_camera, PAIR["left"].T_world_camera, atol=1e-5)
    assert found.rms_px < 1e-3 and found.names == corners


def test_the_place_is_off_by_what_is_said_of_it() -> None:
    ratios = []
    for seed in range(40):
        found = find_table_pose("right", LENSES["right"], clicked("right", sigma_px=1.0, seed=seed))
        off_m = float(np.linalg.norm(found.camera.position_world_m - PAIR["right"].position_world_m))
        ratios.append(off_m / found.sigma_m)
        assert 0.3 < found.rms_px < 3.0
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_too_few_are_refused() -> None:
    with pytest.raises(CalibrationError, match=r"too few corners.*4 or more.*3 in left"):
        find_table_pose("left", LENSES["left"], clicked("left", TOP[:3]))
    with pytest.raises(CalibrationError, match="0 in left"):
        find_table_pose("left", LENSES["left"], clicks_of({"no-corner": (1.0, 2.0)}))


def test_corners_on_one_line_are_refused() -> None:
    line = ("robot-left", "robot-centre", "robot-right")
    with pytest.raises(CalibrationError, match="too few"):
        find_table_pose("left", LENSES["left"], clicked("left", line))
    uvs = np.vstack([clicked("left", line).uvs_px, [[3.0, 4.0]]])
    with pytest.raises(CalibrationError, match=r"on one line.*both sides"):
        find_table_pose("left", LENSES["left"], Clicks((*line, "robot-left"), uvs))


def test_swapped_names_are_refused_as_contradictions() -> None:
    right = clicked("left")
    names = list(right.names)
    names[0], names[2] = names[2], names[0]
    with pytest.raises(CalibrationError, match=r"contradict each other.*check their names"):
        find_table_pose("left", LENSES["left"], Clicks(tuple(names), right.uvs_px))


def test_corners_close_together_leave_the_place_open() -> None:
    near = ("net-left", "post-left", "opponent-left", "opponent-centre")
    far = replace(LENSES["left"], K=np.array([[60.0, 0, 640], [0, 60.0, 360], [0, 0, 1]]))
    view = replace(far, T_world_camera=PAIR["left"].T_world_camera)
    uvs = view.project(np.array([CORNERS[corner] for corner in near]))
    with pytest.raises(CalibrationError, match="leave open where left stands"):
        find_table_pose("left", far, Clicks(near, uvs))


def test_both_cameras_are_written_under_a_new_name_each_time_and_read_again(tmp_path) -> None:
    clicks = {name: clicked(name) for name in PAIR}
    poses = place_at_table(LENSES, clicks)
    first, second = (write_table_calibration(tmp_path, "table", poses, clicks) for _ in range(2))
    assert first.calibration.name == "table.toml" and second.calibration.name == "table-2.toml"
    read = load_calibration(first.calibration)
    assert list(read) == list(PAIR)
    pair = EpipolarPair(*read.values())
    ball = np.array([[-0.5, 0.1, 0.2], [0.3, -0.2, 0.3]])
    assert np.abs(pair.residuals_px(*(camera.project(ball) for camera in PAIR.values()))).max() < 0.01
    again = read_clicks(second.corners)
    assert again["left"].names == tuple(CORNERS)
    np.testing.assert_allclose(again["left"].uvs_px, clicks["left"].uvs_px, atol=0.006)


def test_every_camera_needs_its_lens_and_its_clicks() -> None:
    with pytest.raises(CalibrationError, match=r"lens of right is not known.*calibrate intrinsics"):
        place_at_table({"left": LENSES["left"], "right": None}, {"left": clicked("left")})
    with pytest.raises(CalibrationError, match="0 in right"):
        place_at_table(LENSES, {"left": clicked("left")})
