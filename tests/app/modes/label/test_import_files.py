"""What the app shows of label files before they are accepted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.modes.label.label_files import (
    FOLDER,
    RING,
    SIDE_PX,
    ImportAsk,
    files_to_import,
    picture_of_label,
    preview_html,
    preview_import,
)
from app.modes.label.sources import sources_of
from core.errors import LabelError
from core.recordings import open_recording
from labels.model import Label, LabelState
from tests.labels.formats.import_command import make_recording

TABLE = "t_us,state,x_px,y_px,r_px\n100000,visible,640,180,10\n200000,visible,650,181,10\n300000,no_ball,,,\n"


@pytest.fixture
def recording(tmp_path: Path):
    with open_recording(make_recording(tmp_path / "rec.h5", ("left", "right"))) as found:
        yield found


def ask(recording, path: Path, kind: str = "csv", times: Path | None = None) -> ImportAsk:
    return ImportAsk(path, kind, times, "", False, False, recording, sources_of(recording)["left"])


def test_only_what_lies_in_the_folder_is_offered_and_nothing_hidden_or_linked(tmp_path: Path) -> None:
    assert files_to_import(tmp_path) == {}
    folder = tmp_path / FOLDER
    (folder / "yolo").mkdir(parents=True)
    for name in ("b.xml", "._b.xml", ".DS_Store"):
        (folder / name).write_text("x")
    (folder / "link.json").symlink_to("/etc/hostname")
    assert files_to_import(tmp_path) == {"b.xml": folder / "b.xml", "yolo": folder / "yolo"}


def test_a_preview_has_the_table_and_three_pictures_and_stores_nothing(tmp_path: Path, recording) -> None:
    table = tmp_path / "a.csv"
    table.write_text(TABLE + "400000,visible,9999,1,\n")
    preview = preview_import(ask(recording, table))
    assert (preview.report.taken, preview.report.files) == (3, 1)
    assert [item.reason for item in preview.report.rejected] == ["the centre is outside the picture"]
    assert preview.picture is not None and preview.picture.shape == (SIDE_PX, 2 * SIDE_PX, 3)
    html = preview_html(preview, tmp_path)
    assert "rejected: the centre is outside the picture" in html and "a.csv:5: " in html
    assert str(tmp_path) not in html


def test_names_in_files_are_no_markup(tmp_path: Path, recording) -> None:
    table = tmp_path / "<b>a.csv"
    table.write_text("t_us,state,x_px,y_px\n1,<script>,1,1\n")
    html = preview_html(preview_import(ask(recording, table)), tmp_path)
    assert "<script>" not in html and "&lt;script&gt;" in html and "<b>a" not in html


def test_nothing_to_take_has_no_picture(tmp_path: Path, recording) -> None:
    (tmp_path / "a.csv").write_text("t_us,state\n")
    preview = preview_import(ask(recording, tmp_path / "a.csv"))
    assert preview.picture is None and preview.report.taken == 0
    with pytest.raises(LabelError, match="no longer there"):
        preview_import(ask(recording, tmp_path / "b.csv"))
    with pytest.raises(LabelError, match="frame times"):
        preview_import(ask(recording, tmp_path / "a.csv", times=make_recording(tmp_path / "no-table.csv")))


@pytest.mark.parametrize(("x", "y", "r"), [(640.0, 180.0, 10.0), (0.0, 0.0, 30.0), (1279.0, 719.0, 2.0)])
def test_the_circle_of_a_label_is_in_the_middle_of_its_picture(recording, x: float, y: float, r: float) -> None:
    label = Label(t_us=500_000, state=LabelState.VISIBLE, x_px=x, y_px=y, r_px=r)
    picture = picture_of_label(sources_of(recording)["left"], label)
    rows, columns = np.nonzero((picture == RING).all(axis=2))
    assert picture.shape == (SIDE_PX, SIDE_PX, 3)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(SIDE_PX / 2, abs=4)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(SIDE_PX / 2, abs=4)


def test_the_events_under_a_label_are_where_they_are_on_the_sensor(tmp_path: Path, recording) -> None:
    source = sources_of(recording)["left"]
    events = source.events(499_000, 501_000)
    x, y = int(events.x_px[0]), int(events.y_px[0])
    label = Label(t_us=500_000, state=LabelState.VISIBLE, x_px=float(x + 4), y_px=float(y + 4), r_px=4.0)
    picture = picture_of_label(source, label)
    half = 24
    scale = SIDE_PX / (2 * half + 1)
    spot = picture[int((half - 4 + 0.5) * scale), int((half - 4 + 0.5) * scale)]
    assert tuple(spot) in ((0, 0, 0), (255, 255, 255))
