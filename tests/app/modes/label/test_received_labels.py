"""Files of labels that browsers send: where they go, and what is refused without a trace."""

from __future__ import annotations

import sqlite3
import stat
import zipfile
from contextlib import closing
from pathlib import Path

import pytest

from app.modes.label import received_labels
from app.modes.label.comparer import FOLDER as STORES
from app.modes.label.label_files import FOLDER, MAX_ENTRIES, files_to_import
from app.modes.label.received_labels import place_label_file
from core.errors import LabelError
from core.files import claimed
from labels.model import Label, LabelState
from labels.store import LabelStore
from labels.store_contents import copy_store, read_store


@pytest.fixture
def incoming(tmp_path: Path) -> Path:
    folder = tmp_path / "incoming"
    folder.mkdir()
    return folder


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    return tmp_path / "workspace"


def zipped(incoming: Path, **members: bytes) -> Path:
    path = incoming / "of-bea.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def test_a_file_goes_where_the_import_looks_under_a_name_that_is_free(incoming: Path, workspace: Path) -> None:
    for expected in ("clicks.csv", "clicks-2.csv", "clicks-3.csv"):
        path = incoming / "clicks.csv"
        path.write_text(expected)
        assert place_label_file(path, workspace) == expected
        assert files_to_import(workspace)[expected].read_text() == expected
    assert not list(incoming.iterdir())
    with claimed([workspace / FOLDER / "clicks-4.csv"]):  # by another server that receives one now
        path.touch()
        assert place_label_file(path, workspace) == "clicks-5.csv"
        assert len(files_to_import(workspace)) == 4, "a claim is no file"


def test_a_zip_becomes_a_folder_without_what_systems_add(incoming: Path, workspace: Path) -> None:
    members = {
        "out/labels/left 1.txt": b"1",
        "out/labels/classes.txt": b"ball",
        "__MACOSX/out/._x": b"",
        "out/.DS_Store": b"",
    }
    assert place_label_file(zipped(incoming, **members), workspace) == "of-bea"
    found = files_to_import(workspace)["of-bea"]
    assert sorted(path.relative_to(found).as_posix() for path in found.rglob("*")) == ["classes.txt", "left 1.txt"]


@pytest.mark.parametrize(
    "name",
    [
        "../outside.txt",
        "/etc/passwd",
        "a/../../b.txt",
        "..\\outside.txt",
        "C:\\b.txt",
        "a/b\x07.txt",
        "a" * 200,
        "1/2/3/4/5/6/7",
    ],
)
def test_names_in_a_zip_lead_nowhere_else(incoming: Path, workspace: Path, name: str) -> None:
    with pytest.raises(LabelError, match="no plain files"):
        place_label_file(zipped(incoming, **{"first.txt": b"1", name: b"2"}), workspace)
    assert not workspace.exists() or not files_to_import(workspace)


def test_a_zip_that_holds_too_much_is_refused_whatever_it_says_of_its_sizes(
    incoming: Path, workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(received_labels, "MAX_UNPACKED_BYTES", 10_000)
    with pytest.raises(LabelError, match="too much in the ZIP"):
        place_label_file(zipped(incoming, **{"a.txt": bytes(6000), "b.txt": bytes(6000)}), workspace)
    monkeypatch.setattr(received_labels, "MAX_FILES", 2)
    with pytest.raises(LabelError, match="too many files in the ZIP"):
        place_label_file(zipped(incoming, **{f"{number}.txt": b"" for number in range(3)}), workspace)
    assert not files_to_import(workspace)


def test_links_and_what_is_no_zip_are_refused(incoming: Path, workspace: Path) -> None:
    path = zipped(incoming)
    with pytest.raises(LabelError, match="holds no files"):
        place_label_file(path, workspace)
    link = zipfile.ZipInfo("link.txt")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(LabelError, match="a ZIP with links"):
        place_label_file(path, workspace)
    path.write_bytes(b"PK no zip at all")
    with pytest.raises(LabelError, match="not a ZIP file"):
        place_label_file(path, workspace)
    assert not files_to_import(workspace)


def test_what_waits_has_an_end(incoming: Path, workspace: Path) -> None:
    (workspace / FOLDER).mkdir(parents=True)
    for number in range(MAX_ENTRIES):
        (workspace / FOLDER / str(number)).touch()
    path = incoming / "one-more.csv"
    path.touch()
    with pytest.raises(LabelError, match="too many files wait there"):
        place_label_file(path, workspace)


def test_a_store_is_downloaded_whole_and_goes_to_those_that_can_be_compared_with(
    incoming: Path, workspace: Path, tmp_path: Path
) -> None:
    folder, copy = tmp_path / "labels", incoming / "labels.sqlite"
    with LabelStore.open(folder, "one", "left", "bea") as store:
        for t_us in (1000, 2000):
            store.put(Label(t_us=t_us, state=LabelState.NO_BALL))
        store.delete(1000)
        assert copy_store(folder, "one", copy) == 1  # while it is being written to
    assert not copy.with_name("labels.sqlite-wal").exists()
    with closing(sqlite3.connect(copy)) as db:
        assert db.execute("SELECT count(*) FROM edits").fetchone()[0] == 3, "with its history"
    assert place_label_file(copy, workspace) == f"{STORES}/labels.sqlite"
    ((layer, labels),) = read_store(workspace / STORES / "labels.sqlite").layers.items()
    assert layer.annotator == "bea" and list(labels) == [2000]
    with pytest.raises(LabelError, match="no labels of this recording"):
        copy_store(folder, "two", incoming / "none.sqlite")
    other = incoming / "other.sqlite"
    with closing(sqlite3.connect(other)) as db:
        db.execute("CREATE TABLE x (y)")
    with pytest.raises(LabelError, match="not a label store"):
        place_label_file(other, workspace)
