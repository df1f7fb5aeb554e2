import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from app.shared.files import OfferedFiles, bring_in, incoming_folder
from app.shared.library import Library
from app.shared.workspace import Workspace
from core.errors import RecordingError
from core.files import clear_unfinished, end_unfinished
from tests.app.shared.event_files import write_csv, write_npz


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "data")


@pytest.fixture
def library(workspace: Workspace) -> Library:
    return Library(workspace)


def left_in(workspace: Workspace) -> list[str]:
    return sorted(path.name for path in workspace.recordings.iterdir())


def test_an_event_file_from_elsewhere_becomes_a_recording_once(workspace, library, tmp_path) -> None:
    file = write_npz(tmp_path / "My Clip.npz")
    shares: list[float] = []
    name = bring_in(file, library, workspace, progress=shares.append)
    assert name == "my-clip" and shares[-1] == 1.0 and file.exists()
    with library.open(name) as recording:
        assert sum(stream.event_count for stream in recording.cameras.values()) == 500
        assert "My Clip.npz" in recording.notes[0]
    assert bring_in(file, library, workspace) == "my-clip" and left_in(workspace) == ["my-clip.h5"]


def test_another_file_of_the_same_name_overwrites_nothing(workspace, library, tmp_path) -> None:
    bring_in(write_npz(tmp_path / "clip.npz"), library, workspace)
    before = workspace.recording_path("clip").read_bytes()
    assert bring_in(write_csv(tmp_path / "clip.csv", 70), library, workspace) == "clip-2"
    assert workspace.recording_path("clip").read_bytes() == before and left_in(workspace) == ["clip-2.h5", "clip.h5"]


def test_a_recording_stays_where_it_is_unless_it_was_received(workspace, library, tmp_path, serve_recording) -> None:
    assert bring_in(serve_recording, library, workspace) == "serve" == bring_in(serve_recording, library, workspace)
    assert library.file_of("serve") == serve_recording and not left_in(workspace)
    folder = incoming_folder(workspace)
    received = Path(shutil.copy(serve_recording, folder / "Mine.h5"))
    assert bring_in(received, library, workspace, received=True) == "mine"
    assert not received.exists() and library.file_of("mine") == workspace.recordings / "mine.h5"
    again = Path(shutil.copy(serve_recording, folder / "Mine.h5"))
    assert bring_in(again, library, workspace, received=True) == "mine", "the same is there already"


def test_one_of_the_workspace_keeps_its_name(workspace, library) -> None:
    file = write_csv(workspace.recordings / "Court 1.csv")
    assert bring_in(file, library, workspace) == "Court 1" and left_in(workspace) == ["Court 1.csv", "Court 1.h5"]


@pytest.mark.parametrize("content", [b"", b"no events", b"PK\x03\x04 not a zip", b"\x89HDF\r\n\x1a\n cut", bytes(5000)])
def test_nothing_is_left_of_a_bad_file(workspace, library, tmp_path, content) -> None:
    file = tmp_path / "bad.raw"
    file.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        bring_in(file, library, workspace)
    assert "\n" not in str(error.value) and not left_in(workspace)


def test_nothing_is_left_of_one_that_is_cancelled_or_has_no_room(workspace, library, tmp_path, monkeypatch) -> None:
    file = write_npz(tmp_path / "clip.npz")
    assert bring_in(file, library, workspace, cancelled=lambda: True) is None and not left_in(workspace)
    monkeypatch.setattr("app.shared.files.MIN_FREE_BYTES", 10**18)
    with pytest.raises(RecordingError, match="too full"):
        bring_in(file, library, workspace)
    assert not left_in(workspace)


def test_what_a_killed_app_left_goes_and_what_is_being_sent_stays_whatever_the_clock_says(workspace) -> None:
    code = "import sys; from pathlib import Path; from app.shared.files import incoming_folder; " + (
        "from app.shared.workspace import Workspace; folder = incoming_folder(Workspace(Path(sys.argv[1]))); "
        "(folder / 'half.raw').write_bytes(b'x'); print(folder, flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(workspace.root)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        theirs, ours = Path(other.stdout.readline().strip()), incoming_folder(workspace)
        for folder in (theirs, ours):
            (folder / "half.raw").write_bytes(b"x")
            for path in (folder / "half.raw", folder):
                os.utime(path, (1e9, 1e9))
        clear_unfinished(workspace.recordings)
        assert theirs.is_dir() and ours.is_dir(), "both are being sent, however long ago the clock says that was"
        other.kill()
    incoming_folder(workspace)
    assert not theirs.exists() and (ours / "half.raw").exists()
    end_unfinished(ours)
    assert not ours.exists()


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
