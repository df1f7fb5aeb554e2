from pathlib import Path

import cv2
import numpy as np
import pytest

from core.cameras import Camera, load_calibration
from core.cameras.calibration.intrinsics import save_lens
from core.errors import CalibrationError
from core.events import SensorSize

pytestmark = pytest.mark.numeric
CAMERA = Camera(
    SensorSize(640, 480),
    np.array([[520.5, 0, 322.3], [0, 523.25, 236.1], [0, 0, 1]]),
    np.array([-0.15, 0.05, 0.0008, -0.0005, 0.01]),
    np.eye(4),
)


@pytest.mark.parametrize(("file", "name"), [("lens.yaml", "camera"), ("lens.yml", "camera"), ("lens.toml", "left")])
def test_what_is_written_is_read_again(tmp_path: Path, file: str, name: str) -> None:
    save_lens(tmp_path / file, "left", CAMERA, notes={"rms_px": 0.25, "camera_name": "left"})
    ((found_name, found),) = load_calibration(tmp_path / file).items()
    assert found_name == name and found.sensor == CAMERA.sensor
    np.testing.assert_array_equal(found.K, CAMERA.K)
    np.testing.assert_array_equal(found.distortion, CAMERA.distortion)
    assert [path.name for path in tmp_path.iterdir()] == [file], "nothing half written is left"


def test_opencv_itself_reads_the_yaml(tmp_path: Path) -> None:
    save_lens(tmp_path / "lens.yaml", "left", CAMERA, notes={"rms_px": 0.25})
    storage = cv2.FileStorage(str(tmp_path / "lens.yaml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), CAMERA.K)
    assert storage.getNode("rms_px").real() == 0.25 and storage.getNode("image_width").real() == 640


def test_a_folder_that_is_a_file_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot write the calibration"):
        save_lens(tmp_path / "file" / "lens.yaml", "left", CAMERA)
