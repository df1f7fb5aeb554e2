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
    assert library.file_of(library.add_guest(guest)) == guest


@pytest.mark.parametrize(("name", "says"), [("live", "no file yet"), ("../mine", "no such recording")])
def test_what_is_live_or_not_in_the_list_has_no_file(library: Library, name: str, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        library.file_of(name)
