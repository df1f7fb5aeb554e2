"""Sony's layout of rallies and labels, made here with h5py after its description."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.model import Label, LabelState, PositionSource

SENSOR = SensorSize(1280, 720)
YAML = """
evsA: {resolution: [1280, 720], camera_matrix: [[841.0, 0, 650.0], [0, 842.0, 358.0], [0, 0, 1]],
  distortion_coeffs: [-0.2, 0.08, 0.001, 0.002], T_CW: [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
evsB: {resolution: [1280, 720], camera_matrix: [[800.0, 0, 640.0], [0, 800.0, 360.0], [0, 0, 1]],
  distortion_coeffs: [0, 0, 0, 0], T_CW: [[1, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
T_WO: [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]]
"""


def write_rally(folder, camera, t0, name="seq_001_a", labels=5):
    here = folder / "h5" / camera
    here.mkdir(parents=True, exist_ok=True)
    t = np.arange(0, 9_000, 3, dtype="i8")
    with h5py.File(here / f"{name}.h5", "w") as file:
        file["events/t"], file["events/p"] = t, (np.arange(len(t)) % 2).astype("u1")
        file["events/x"], file["events/y"] = (np.arange(len(t)) % 1280).astype("u2"), np.full(len(t), 7, "u2")
        file["t0"] = np.array([t0], "i8")
        file["ms_to_idx"] = np.searchsorted(t, np.arange(9) * 1000).astype("u4")
    with h5py.File(here / f"{name}_label.h5", "w") as file:
        points = np.stack([100.0 + np.arange(labels), np.full(labels, 50.0)], axis=1)
        points[2] = np.nan
        for name in ("points", "points_orig"):
            file[name] = points
        for name in ("radius", "radius_orig"):
            file[name] = np.full(labels, 9.0)
        file["velocities"], file["timestamps"] = np.zeros((labels, 2)), 77.0 + np.arange(labels) / 1000
    return here


def test_all_cameras_of_a_rally_are_on_the_clock_of_their_t0(tmp_path):
    write_rally(tmp_path, "evsA", 1_000_000)
    write_rally(tmp_path, "evsB", 1_002_000)
    (tmp_path / "rig.yaml").write_text(YAML)
    import_recording(ImportOrder([tmp_path / "h5"]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        first, second = (recording.cameras[name].slice(0, 20_000) for name in ("evsA", "evsB"))
        assert first.t_us[:3].tolist() == [0, 3, 6]
        assert second.t_us[:3].tolist() == [2000, 2003, 2006]
        assert first.on[:2].tolist() == [False, True]
        camera = recording.cameras["evsA"].calibration
        assert recording.cameras["evsA"].sensor == SENSOR
        assert camera.K[0].tolist() == [841, 0, 650]
        assert camera.distortion.tolist() == [-0.2, 0.08, 0.001, 0.002, 0]
        np.testing.assert_allclose(camera.to_camera([[1.0, 2.0, 3.0]]), [[1.5, -3.0, 5.0]])  # table -> world -> camera
        assert any("the world is the table's frame, T_WO" in note for note in recording.notes)


def test_a_rally_whose_size_nobody_tells_is_refused_and_several_are_listed(tmp_path):
    here = write_rally(tmp_path, "evsA", 5)
    with pytest.raises(RecordingError, match="does not say how large the sensor is; give --width and --height"):
        import_recording(ImportOrder([here / "seq_001_a.h5"]), tmp_path / "out.h5")
    import_recording(ImportOrder([here / "seq_001_a.h5"], sensor=SENSOR), tmp_path / "out.h5")
    write_rally(tmp_path, "evsA", 5, name="seq_002_b")
    with pytest.raises(RecordingError, match=r"several rallies; got 2: seq_001_a\.h5, seq_002_b\.h5"):
        import_recording(ImportOrder([tmp_path / "h5"], sensor=SENSOR), tmp_path / "other.h5")


def test_labels_lie_in_the_middle_of_their_millisecond_on_the_clock_of_the_recording(tmp_path):
    write_rally(tmp_path, "evsA", 1_000_000)
    write_rally(tmp_path, "evsB", 1_002_000)
    context = ImportContext(SENSOR, None, "import sony", "evsB", clock_us=1_000_000)
    found = FORMATS["sony"].read(tmp_path / "h5", context)
    assert found.rejections == ()
    assert [label.t_us for label in found.labels] == [2500, 3500, 5500, 6500]  # the third row is nan
    assert (found.labels[0].x_px, found.labels[0].y_px, found.labels[0].r_px) == (100.0, 50.0, 9.0)
    assert {label.provenance.source for label in found.labels} == {PositionSource.IMPORTED}


def test_labels_without_their_events_are_rejected_where_the_clock_matters(tmp_path):
    here = write_rally(tmp_path, "evsA", 1_000_000)
    (here / "seq_001_a.h5").unlink()
    found = FORMATS["sony"].read(here, ImportContext(SENSOR, None, "", "evsA", clock_us=7))
    assert found.labels == ()
    assert "seq_001_a.h5, which tells t0, is not beside it" in found.rejections[0].reason


def test_what_is_written_has_the_columns_of_the_layout(tmp_path):
    labels = tuple(
        Label(t_us=500 + 1000 * k, state=LabelState.VISIBLE, x_px=10.0 + 2 * k, y_px=5.0, r_px=4.0) for k in range(4)
    )
    written = FORMATS["sony"].write(LabelSet("r", "evsA", "anna", SENSOR, labels), tmp_path, ExportOptions())
    assert written.files == (tmp_path / "evsA" / "seq_000_rally_label.h5",)
    with h5py.File(written.files[0]) as file:
        assert file["points"].shape == (4, 2)
        assert file["points"][2].tolist() == [14, 5]
        assert file["radius"][:].tolist() == [4, 4, 4, 4]
        np.testing.assert_allclose(file["velocities"][:], [[2000, 0]] * 4)
        np.testing.assert_allclose(file["timestamps"][:], [0.0005, 0.0015, 0.0025, 0.0035])


@pytest.mark.parametrize("name", ["points", "labels"])
def test_labels_that_are_a_link_to_another_file_are_not_read(name, tmp_path):
    here = write_rally(tmp_path, "evsA", 0)
    theirs, path = tmp_path / "theirs.h5", here / "seq_001_a_label.h5"
    with h5py.File(theirs, "w") as file:
        file["points"] = np.full((5, 2), 50.0)
        for column, value in {"t_us": [7], "state": [b"visible"], "x_px": [5.0], "y_px": [6.0], "r_px": [4.0]}.items():
            file[f"labels/evsA/{column}"] = value
    with h5py.File(path, "r+") as file:
        file.pop(name, None)
        file[name] = h5py.ExternalLink(str(theirs), f"/{name}")
    read = FORMATS["sony"].read(path, ImportContext(SENSOR, None, "", "evsA"))
    assert 50.0 not in [label.x_px for label in read.labels] and 7 not in [label.t_us for label in read.labels]
    assert len(read.labels) == (0 if name == "points" else 4)
    with h5py.File(theirs, "r+") as file:
        file["labels/other"] = h5py.ExternalLink(str(path), "/")
    read = FORMATS["hdf5"].read(theirs, ImportContext(SENSOR, None, "", "other"))
    assert not read.labels and "not a group of columns" in read.rejections[0].reason
