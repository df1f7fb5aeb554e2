from pathlib import Path
from types import SimpleNamespace

import pytest

from app.shared.library import Library
from app.shared.workspace import Workspace
from core.errors import RecordingError


@pytest.fixture
def library(tmp_path: Path) -> Library:
    workspace = Workspace(tmp_path / "data")
    workspace.recording_path("mine").write_bytes(b"")
    library = Library(workspace)
    library.add_live("live", SimpleNamespace())  # type: ignore[arg-type]
    return library


def test_recordings_have_files_of_the_workspace_and_guests_their_own(library: Library, tmp_path: Path) -> None:
    guest = tmp_path / "guest.raw"
    assert library.file_of("mine") == tmp_path / "data" / "recordings" / "mine.h5"
    assert library.file_of(library.add_external(guest)) == guest


def test_a_recording_of_the_workspace_given_by_its_path_is_there_once(library: Library, tmp_path, monkeypatch) -> None:
    """As README has it: `import ... rallyscope-data/recordings/mine.h5`, then `serve` with that path."""
    monkeypatch.chdir(tmp_path)
    assert library.add_external(Path("data/recordings/mine.h5")) == "mine"
    assert library.names() == ("live", "mine")
    assert library.add_external(tmp_path / "mine.h5") == "mine-file"  # another file of that name


@pytest.mark.parametrize(("name", "says"), [("live", "no file yet"), ("../mine", "no such recording")])
def test_what_is_live_or_not_in_the_list_has_no_file(library: Library, name: str, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        library.file_of(name)


def test_an_event_file_in_the_folder_is_offered_with_its_kind_and_becomes_a_recording(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    rows = "\n".join(f"{1000 * k},{k % 30},{k % 20},{k % 2}" for k in range(500))
    (workspace.recordings / "clip.csv").write_text(f"t,x,y,p\n{rows}\n")
    (workspace.recordings / "notes.txt").write_text("not for the list")
    library = Library(workspace)
    (name,) = library.names()
    assert name == "clip.csv (CSV, imported when opened)" and library.file_to_import(name)
    recording = library.open(name)
    assert sum(stream.event_count for stream in recording.cameras.values()) == 500
    assert library.names() == ("clip",) and library.settled_name(name) == "clip" and library.has(name)
    assert (workspace.recordings / "clip.h5").is_file() and library.file_to_import(name) is None
    assert library.open("clip") is recording and library.open(name) is recording
    library.close()


def test_an_event_file_that_cannot_be_read_says_so_and_stays_in_the_list(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    (workspace.recordings / "broken.raw").write_bytes(b"no events")
    library = Library(workspace)
    (name,) = library.names()
    with pytest.raises(RecordingError, match=r"broken\.raw"):
        library.open(name)
    assert library.names() == (name,)
