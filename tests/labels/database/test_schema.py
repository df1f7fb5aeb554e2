from __future__ import annotations

import re
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import pytest

from core.errors import LabelError
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer, find_layers

UUID = "9f3c-1"
LAYER = Layer(UUID, "left", "anna")
NOW_NS = 1_760_000_000 * 10**9


@pytest.fixture
def store_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A closed store with three labels, one of them moved and one taken back, all at `NOW_NS`."""
    monkeypatch.setattr("labels.database.edit_log.time.time_ns", lambda: NOW_NS)
    with LabelStore.open(tmp_path, UUID, "left", "anna", tool="trial 1") as store:
        store.put(Label(t_us=1, state=LabelState.VISIBLE, x_px=5.0, y_px=6.0, r_px=7.0))
        store.put(Label(t_us=2, state=LabelState.NO_BALL))
        store.put(Label(t_us=1, state=LabelState.VISIBLE, x_px=5.5, y_px=6.0, r_px=7.0))
        store.delete(2)
        return store.path


def change(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(statement)


def test_a_closed_store_is_one_file_that_anyone_can_query(store_file: Path) -> None:
    assert [file.name for file in store_file.parent.iterdir()] == ["labels.sqlite"]
    with closing(sqlite3.connect(store_file)) as db:
        assert db.execute("SELECT camera, whose, t_us, state, x_px, r_px FROM labels").fetchall() == [
            ("left", "anna", 1, "visible", 5.5, 7.0)
        ]
        history = db.execute("SELECT edit, kind, annotator, t_us, state, x_px FROM history ORDER BY edit").fetchall()
        assert history == [
            (1, "edit", "anna", 1, "visible", 5.0),
            (2, "edit", "anna", 2, "no_ball", None),
            (3, "edit", "anna", 1, "visible", 5.5),
            (4, "edit", "anna", 2, None, None),
        ]
        assert db.execute("SELECT DISTINCT made_at_utc FROM history").fetchall() == [("2025-10-09 08:53:20",)]


def test_the_sqlite3_tool_reads_it(store_file: Path) -> None:
    tool = shutil.which("sqlite3")
    if tool is None:
        pytest.skip("no sqlite3 tool here; the library reads it in the test above")
    query = "SELECT t_us, x_px FROM labels"
    assert subprocess.check_output([tool, str(store_file), query], text=True) == "1|5.5\n"


def test_the_queries_of_the_page_on_labels_give_what_it_says(store_file: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "use" / "labels-in-depth.md").read_text(encoding="utf-8")
    queries = re.findall(r'^sqlite3 .*labels\.sqlite "(.*)"$', page, re.MULTILINE)
    with closing(sqlite3.connect(store_file)) as db:
        counts, history, table = (db.execute(query).fetchall() for query in queries)
    assert counts == [("anna", "left", "visible", 1)]
    assert [row[1:] for row in history[:2]] == [
        ("edit", "anna", 2, None, None),
        ("edit", "anna", 1, "visible", 5.5),
    ]
    assert table == [(1, 5.5, 6.0, 7.0)]


@pytest.mark.parametrize("radius", ["0", "-1", "0.0"])
def test_not_even_another_tool_can_store_a_radius_of_0(store_file: Path, radius: str) -> None:
    with pytest.raises(sqlite3.IntegrityError):
        change(store_file, f"UPDATE changes SET r_px = {radius}")


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE TRIGGER t AFTER INSERT ON changes BEGIN DELETE FROM changes; END",
        "CREATE VIEW everything AS SELECT * FROM changes",
        "CREATE TABLE more (a)",
        "DROP VIEW labels",
        "ALTER TABLE changes ADD COLUMN more TEXT",
        "DROP INDEX changes_of_edit",
        "CREATE VIRTUAL TABLE words USING fts5(a)",
    ],
)
def test_a_file_with_another_schema_is_refused_before_anything_of_it_is_run(store_file: Path, statement: str) -> None:
    change(store_file, statement)
    for act in (
        lambda: LabelStore.read(store_file.parent.parent, LAYER),
        lambda: LabelStore.open(store_file.parent.parent, UUID, "left", "anna"),
        lambda: find_layers(store_file.parent.parent),
    ):
        with pytest.raises(LabelError, match="other tables than ours"):
            act()


def test_a_view_that_only_has_the_name_of_ours_is_not_ours(store_file: Path) -> None:
    change(store_file, "DROP VIEW labels")
    change(store_file, "CREATE VIEW labels AS SELECT load_extension('evil') AS t_us")
    with pytest.raises(LabelError, match="'labels'"):
        LabelStore.read(store_file.parent.parent, LAYER)


def test_statistics_that_another_tool_has_gathered_do_no_harm(store_file: Path) -> None:
    change(store_file, "ANALYZE")
    assert LabelStore.read(store_file.parent.parent, LAYER).labels().t_us.tolist() == [1]


def test_later_versions_and_other_databases_are_refused(store_file: Path) -> None:
    folder = store_file.parent.parent
    change(store_file, "PRAGMA user_version = 99")
    with pytest.raises(LabelError, match=r"another version.*99.*update"):
        LabelStore.read(folder, LAYER)
    change(store_file, "PRAGMA user_version = 2")
    change(store_file, "PRAGMA application_id = 1")
    with pytest.raises(LabelError, match="not a label store"):
        LabelStore.open(folder, UUID, "left", "anna")


def test_the_store_of_another_recording_is_refused(store_file: Path) -> None:
    other = store_file.parent.parent / "other"
    store_file.parent.rename(other)
    with pytest.raises(LabelError, match="something else"):
        LabelStore.open(other.parent, "other", "left", "anna")
    with pytest.raises(LabelError, match="something else"):
        LabelStore.read(other.parent, Layer("other", "left", "anna"))


def test_values_that_no_label_has_are_an_error_and_not_a_crash(store_file: Path) -> None:
    change(store_file, "UPDATE changes SET source = 'magic', x_px = 9e999")
    with pytest.raises(LabelError):
        LabelStore.read(store_file.parent.parent, LAYER)
