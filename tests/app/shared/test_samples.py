"""Sample recordings: simulated ones open at once, a public file becomes a recording with one click once it is there."""

import re
from pathlib import Path

import pytest

from app.client_session.file_opening import list_message
from app.shared.files import OfferedFiles, bring_in
from app.shared.library import Library
from app.shared.samples import PAGE, PUBLIC, PUBLIC_FILES, SIMULATED, missing_samples, sample_folders
from app.shared.workspace import Workspace
from core.recordings import knows_ball
from docs.make_samples import LARGEST_BYTES, SAMPLES
from tests.app.shared.event_files import write_csv
from tests.conftest import HERE


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "data")


def test_simulated_samples_are_offered_and_open_with_their_true_ball(workspace) -> None:
    files = OfferedFiles(workspace, (), sample_folders(workspace)).all()
    assert [(file.path.stem, file.folder) for file in files] == [(name, SIMULATED) for name in sorted(SAMPLES)]
    assert sum(file.size_bytes for file in files) <= LARGEST_BYTES
    library = Library(workspace)
    for file in files:
        recording = library.open(bring_in(file.path, library, workspace) or "")
        assert len(recording.cameras) == 2 and knows_ball(recording)
        assert all(stream.calibration is not None for stream in recording.cameras.values())
    library.close()
    assert not list(workspace.recordings.iterdir()), "nothing is copied"


def test_a_public_file_is_offered_once_it_is_there_and_becomes_a_recording(workspace) -> None:
    offered = OfferedFiles(workspace, (), sample_folders(workspace))
    assert not [file for file in offered.all() if file.folder == PUBLIC]
    write_csv(workspace.samples / "mine.csv")
    (file,) = (file for file in offered.all() if file.folder == PUBLIC)
    library = Library(workspace)
    assert bring_in(file.path, library, workspace) == "mine" and workspace.recording_path("mine").is_file()
    assert file.path.is_file()


def test_what_no_folder_has_is_named_with_the_folder_and_the_page() -> None:
    assert missing_samples(()) == tuple(PUBLIC_FILES)
    missing = missing_samples({"gen4.dat", "other.raw"})
    assert missing == tuple(name for name in PUBLIC_FILES if name != "planet")
    hint = str(list_message((), missing)["samples"])
    assert "walker" in hint and "folder samples" in hint and PAGE in hint and "planet" not in hint
    assert list_message((), ())["samples"] == ""


def test_the_page_names_the_file_of_every_public_sample_and_every_simulated_one() -> None:
    page = (HERE.parent / PAGE).read_text()
    for name, files in PUBLIC_FILES.items():
        (row,) = re.findall(rf"^\| {name} \|.*$", page, re.MULTILINE)
        assert any(f"/{file}`" in row for file in files), name
    assert all(f"`{name}.h5`" in page for name in SAMPLES)
