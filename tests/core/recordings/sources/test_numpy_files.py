import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

from core.errors import RecordingError
from core.recordings.sources import numpy_files, open_sources


def write(path: Path) -> Path:
    k = np.arange(5000)
    np.savez_compressed(path, t=10 * k, x=np.zeros_like(k), y=np.zeros_like(k), p=k % 2)
    return path


def test_an_archive_that_unpacks_to_more_than_the_memory_is_refused_before_it_is(tmp_path, monkeypatch) -> None:
    path = write(tmp_path / "bomb.npz")
    monkeypatch.setattr(numpy_files, "_memory_bytes", lambda: 200_000)
    with pytest.raises(RecordingError, match="too large once it is unpacked"):
        open_sources(path)
    monkeypatch.undo()
    (source,) = open_sources(path)
    assert source.format == "NumPy"


def test_a_column_that_claims_to_be_larger_than_any_memory_is_one_clear_error(tmp_path) -> None:
    path = tmp_path / "lie.npz"
    with zipfile.ZipFile(path, "w") as archive:
        header = b"{'descr': '<i8', 'fortran_order': False, 'shape': (1152921504606846975,), }"
        header += b" " * (118 - len(header) - 1) + b"\n"
        column = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64)
        for name in "txyp":
            archive.writestr(f"{name}.npy", column)
    with pytest.raises(RecordingError, match="cannot be read"):
        open_sources(path)


def test_a_folder_of_anything_else_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="a folder without events"):
        open_sources(tmp_path)


@pytest.mark.parametrize("form", ["archive", "old archive", "pickle"])
def test_a_pickled_file_is_refused_in_one_line_and_never_opened(tmp_path, form):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was loaded",))

    path = tmp_path / "labels.pt"
    data = pickle.dumps({"ball_position": Trap()}, protocol=2)
    if form == "archive":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("labels/data.pkl", data)
            archive.writestr("labels/version", "3\n")
    elif form == "old archive":
        path.write_bytes(pickle.dumps(0x1950A86A20F9469CFC6C, protocol=2) + data)
    else:
        file = io.BytesIO()
        pickle.dump([1, 2], file)
        path.write_bytes(file.getvalue())
    with pytest.raises(RecordingError, match="a pickled file is not opened: it could run any program") as caught:
        open_sources(path)
    assert "numpy.savez" in str(caught.value)
    assert "\n" not in str(caught.value)
