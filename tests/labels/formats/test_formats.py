"""Known files of each format, as the tools in the field write them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from core.errors import LabelError
from core.events import Events, SensorSize
from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.formats.documents import DocumentError, parse_xml
from labels.formats.pictures import draw_events
from labels.model import Label, LabelState

SENSOR = SensorSize(1280, 720)
FRAMES = ImportContext(SENSOR, np.arange(10) * 10_000, origin="file")


def read(name: str, file: Path, text: str, context: ImportContext = FRAMES):
    file.write_text(text, encoding="utf-8")
    return FORMATS[name].read(file, context)


def places(imported) -> list[tuple[int, str, float | None, float | None]]:
    return [(label.t_us, label.state.value, label.x_px, label.y_px) for label in imported.labels]


def test_tracknet_v2_rows(tmp_path: Path) -> None:
    imported = read("tracknet", tmp_path / "a.csv", "Frame,Visibility,X,Y\n0,0,0,0\n1,1,640,360\n2,5,1,1\n99,1,1,1\n")
    assert places(imported) == [(0, "no_ball", None, None), (10_000, "visible", 640.0, 360.0)]
    assert [rejection.line for rejection in imported.rejections] == [4, 5]


def test_imglabel_rows_are_shares_of_the_picture_counted_from_its_corner(tmp_path: Path) -> None:
    imported = read("tracknet", tmp_path / "a.csv", "Frame,Ball,x,y\n0,1,0.500,0.250\n1,0,-1,-1\n")
    assert places(imported) == [(0, "visible", 639.5, 179.5), (10_000, "no_ball", None, None)]


def test_tennis_rows_name_their_pictures(tmp_path: Path) -> None:
    text = "file name,visibility,x-coordinate,y-coordinate,status\n0003.jpg,1,599,423,0\n0004.jpg,3,601,406,0\n"
    text += "0005.jpg,0,,,\n"
    imported = read("tracknet", tmp_path / "Label.csv", text)
    assert imported.rejections == ()
    assert places(imported) == [
        (30_000, "visible", 599.0, 423.0),
        (40_000, "occluded", 601.0, 406.0),
        (50_000, "no_ball", None, None),
    ]


def test_tracknet_refuses_unchecked_pictures_and_says_how_to_leave_them_out(tmp_path: Path) -> None:
    label = Label(t_us=1000, state=LabelState.NO_BALL)
    labels = LabelSet("u", "left", "anna", SENSOR, (label,), frames_us=(1000, 2000))
    with pytest.raises(LabelError, match=r"1 pictures.*unchecked.*2000 us.*--unchecked drop"):
        FORMATS["tracknet"].write(labels, tmp_path, ExportOptions())
    FORMATS["tracknet"].write(labels, tmp_path, ExportOptions(drop_unchecked=True))
    assert (tmp_path / "left_ball.csv").read_text() == "Frame,Visibility,X,Y\n0,0,0,0\n"
    assert (tmp_path / "frames.csv").read_text() == "frame,t_us\n0,1000\n"


def test_yolo_classes_are_names_and_not_numbers(tmp_path: Path) -> None:
    (tmp_path / "classes.txt").write_text("racket\nball\n")
    (tmp_path / "frame_1.txt").write_text("1 0.5 0.5 0.0125 0.02\n0 0.1 0.1 0.1 0.1\n")
    imported = FORMATS["yolo"].read(tmp_path, FRAMES)
    assert places(imported) == [(10_000, "visible", 639.5, 359.5)]
    assert [(item.file.name, item.line) for item in imported.rejections] == [("frame_1.txt", 2)]
    (tmp_path / "classes.txt").write_text("racket\n")
    (rejection,) = FORMATS["yolo"].read(tmp_path, FRAMES).rejections
    assert rejection.file.name == "classes.txt" and "--ball-class" in rejection.reason
    (tmp_path / "classes.txt").unlink()
    assert [(item.file, item.line) for item in FORMATS["yolo"].read(tmp_path, FRAMES).rejections] == [(tmp_path, 1)]


@pytest.mark.parametrize("yaml", ["names: [racket, ball]", "names: {0: racket, 1: ball}", "names:\n  1: ball\n"])
def test_yolo_names_may_come_from_a_yaml_file(tmp_path: Path, yaml: str) -> None:
    (tmp_path / "data.yaml").write_text(yaml)
    (tmp_path / "frame_1.txt").write_text("1 0.5 0.5 0.0125 0.02 0.77\n")
    imported = FORMATS["yolo"].read(tmp_path, FRAMES)
    assert imported.rejections == ()
    assert imported.labels[0].r_px == pytest.approx((0.0125 * 1280 + 0.02 * 720) / 4)


def test_coco_boxes_without_keypoints_are_read(tmp_path: Path) -> None:
    text = """{"images": [{"id": 7, "file_name": "a/000002.jpg"}, {"id": 8, "file_name": "3.jpg"}],
    "categories": [{"id": 5, "name": "ball"}, {"id": 6, "name": "person"}],
    "annotations": [
      {"id": 1, "image_id": 7, "category_id": 5, "bbox": [10, 20, 4, 6]},
      {"id": 2, "image_id": 7, "category_id": 6, "bbox": [10, 20, 4, 6]},
      {"id": 3, "image_id": 99, "category_id": 5, "bbox": [1, 2, 3, 4]},
      {"id": 4, "image_id": 7, "category_id": 5,
       "bbox": [1, 2, 3]}, 17]}"""
    imported = read("coco", tmp_path / "a.json", text)
    assert places(imported) == [(20_000, "visible", 11.5, 22.5)]
    assert sorted(rejection.line for rejection in imported.rejections) == [1, 1, 5, 6, 7]
    looked_at = dataclasses.replace(FRAMES, empty_pictures=LabelState.NO_BALL)
    imported = read("coco", tmp_path / "a.json", text, looked_at)
    assert places(imported) == [(20_000, "visible", 11.5, 22.5), (30_000, "no_ball", None, None)]


def test_cvat_boxes_ellipses_and_foreign_shapes(tmp_path: Path) -> None:
    text = """<?xml version="1.0"?>
<annotations><version>1.1</version>
<image id="0" name="f/frame_000000.PNG" width="1280" height="720">
  <box label="ball" occluded="1" xtl="10.0" ytl="20.0" xbr="14.0" ybr="26.0"/></image>
<image id="1" name="frame_000001.PNG" width="1280" height="720">
  <ellipse label="ball" cx="100.5" cy="50.5" rx="4" ry="6"/>
  <polyline label="ball" points="1,1;2,2;3,3"/></image>
<image id="2" name="frame_000002.PNG" width="1280" height="720"/>
<track id="0" label="ball"/>
</annotations>"""
    imported = read("cvat", tmp_path / "a.xml", text)
    assert places(imported) == [
        (0, "partly_occluded", 11.5, 22.5),
        (10_000, "visible", 100.0, 50.0),
    ]
    assert [rejection.line for rejection in imported.rejections] == [7, 8, 9]
    looked_at = dataclasses.replace(FRAMES, empty_pictures=LabelState.NO_BALL)
    assert places(read("cvat", tmp_path / "a.xml", text, looked_at))[2:] == [(20_000, "no_ball", None, None)]


def test_a_picture_whose_time_is_not_known_is_rejected_with_what_to_do(tmp_path: Path) -> None:
    imported = read("tracknet", tmp_path / "a.csv", "Frame,Visibility,X,Y\n0,1,5,5\n", ImportContext(SENSOR))
    assert "--frame-times" in str(imported.rejections[0])


def test_a_declared_encoding_does_not_matter() -> None:
    assert parse_xml('<?xml version="1.0" encoding="utfnan"?><a b="é"/>').attributes == {"b": "é"}


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE a [<!ENTITY l "lol"><!ENTITY m "&l;&l;&l;">]><annotation>&m;</annotation>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]><annotation>&x;</annotation>',
        '<!DOCTYPE a SYSTEM "http://127.0.0.1/a.dtd"><annotation/>',
        "<a>" * 100,
    ],
)
def test_xml_with_entities_or_without_end_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(DocumentError):
        parse_xml(text)
    for name in ("voc", "cvat"):
        imported = read(name, tmp_path / "a.xml", text)
        assert imported.labels == () and len(imported.rejections) == 1


def test_labels_in_a_recording_leave_the_rest_of_it_alone(tmp_path: Path) -> None:
    path = tmp_path / "rec.h5"
    with h5py.File(path, "w") as file:
        file.attrs["uuid"] = "rec-1"
        file["cameras/left/events/t"] = np.arange(100)
    labels = LabelSet("rec-1", "left", "anna", SENSOR, (Label(t_us=5, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0),))
    for _ in range(2):  # the second time it replaces what is there
        FORMATS["hdf5"].write(labels, path, ExportOptions())
    FORMATS["hdf5"].write(dataclasses.replace(labels, camera="right"), path, ExportOptions())
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["cameras/left/events/t"][()], np.arange(100))
        assert file["labels/left/t_us"][()].tolist() == [5]
        assert file["labels/left/x_px"][()].tolist() == [1.0]
        assert file["labels/left/state"][()].tolist() == [b"visible"]
        assert file["labels/left"].attrs["annotator"] == "anna"
    with pytest.raises(LabelError, match="another recording"):
        FORMATS["hdf5"].write(dataclasses.replace(labels, recording_uuid="rec-2"), path, ExportOptions())
    both = FORMATS["hdf5"].read(path, ImportContext(SENSOR))
    assert "left" in str(both.rejections[0]) and "right" in str(both.rejections[0])
    assert len(FORMATS["hdf5"].read(path, ImportContext(SENSOR, camera="right")).labels) == 1
    assert sorted(file.name for file in tmp_path.iterdir()) == ["rec.h5"]


def test_event_pictures_show_the_latest_polarity_of_each_pixel() -> None:
    events = Events.from_columns([1, 2, 3], [1, 1, 2], [0, 0, 1], [True, False, True], SensorSize(4, 2))
    image = draw_events(events)
    assert image.tolist() == [[128, 0, 128, 128], [128, 128, 255, 128]]
    assert cv2.imencode(".png", image)[0]
