import os
import shutil
from pathlib import Path

import pytest

from app.shared.files import OfferedFiles
from app.shared.workspace import Workspace
from tests.app.shared.files.event_files import write_csv, write_npz


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "camera files"
    folder.mkdir()
    write_npz(folder / "clip.npz")
    (folder / "notes.txt").write_text("t,x,y,p\n")
    (folder / ".hidden.csv").write_text("t,x,y,p\n")
    (folder / "picture.png").write_bytes(b"\x89PNG\r\n")
    (folder / "evt.raw").write_bytes(b"% evt 3.0\n% format EVT3;height=720;width=1280\n% end\n" + bytes(64))
    (folder / "below").mkdir()
    write_csv(folder / "below" / "deep.csv")
    os.mkfifo(folder / "pipe.csv")
    return folder


def test_recordings_and_event_files_are_offered_with_their_kind_and_size(tmp_path, folder, serve_recording) -> None:
    workspace = Workspace(tmp_path / "data")
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    files = OfferedFiles(workspace, (folder,)).all()
    assert [(file.path.name, file.folder, file.kind) for file in files] == [
        ("serve.h5", "recordings", "Rallyscope recording"),
        ("clip.npz", "camera files", "NumPy"),
        ("evt.raw", "camera files", "Prophesee EVT3"),
    ]
    assert files[0].size_bytes == serve_recording.stat().st_size


def test_a_key_says_nothing_of_the_path_and_finds_only_what_is_offered_now(tmp_path, folder) -> None:
    offered = OfferedFiles(Workspace(tmp_path / "data"), (folder,))
    clip, _ = offered.all()
    assert "clip" not in clip.key and offered.find(clip.key) == clip
    for key in ("", "../../etc/passwd", str(clip.path), clip.key[:-1], clip.key.upper(), "ü"):
        assert offered.find(key) is None
    assert OfferedFiles(offered.workspace, (folder,)).all()[0].key != clip.key, "of another run of the app"
    clip.path.unlink()
    assert offered.find(clip.key) is None


def test_a_folder_that_is_taken_away_is_no_reason_to_offer_nothing(tmp_path, folder) -> None:
    workspace = Workspace(tmp_path / "data")
    write_csv(workspace.recordings / "mine.csv")
    shutil.rmtree(folder)
    assert [file.path.name for file in OfferedFiles(workspace, (folder,)).all()] == ["mine.csv"]
