"""Public reports of people with label files of other tools, each with a small input made here, through the command.

`before` says what an import did when the report was first tried: mostly it stored something else, with exit code 0.
"""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.events import Events
from labels.formats.exchange import ImportContext
from labels.formats.import_check import import_labels
from tests.labels.formats.import_command import SENSOR, Report, Row, import_files

BALL = "0.5 0.25 0.015625 0.0277778"
AT: Row = (10_000, "visible", 639.5, 179.5)
CVAT, STUDIO = "https://github.com/cvat-ai/cvat", "https://github.com/HumanSignal/label-studio"


def coco(annotations: list[dict], images: list[dict], categories: list[dict]) -> str:
    return json.dumps({"images": images, "annotations": annotations, "categories": categories})


def picture(number: object = 1, name: str = "frame_000001.png", **more: object) -> dict:
    return {"id": number, "file_name": name, **more}


def ball(**more: object) -> dict:
    return {"id": 1, "image_id": 1, "category_id": 1, "bbox": [630, 170, 20, 20], "area": 400, "iscrowd": 0, **more}


BALLS = [{"id": 1, "name": "ball"}]


def track(*shapes: tuple[int, float, int, int]) -> str:
    """Boxes of one track: frame, centre, keyframe, outside."""
    boxes = "".join(
        f'<box frame="{frame}" outside="{outside}" occluded="0" keyframe="{key}" xtl="{x - 10}" ytl="170" '
        f'xbr="{x + 10}" ybr="190"/>'
        for frame, x, key, outside in shapes
    )
    return (
        f'<annotations><version>1.1</version><track id="0" label="ball" source="manual">{boxes}</track></annotations>'
    )


REPORTS = [
    Report(
        f"{CVAT}/issues/7643",
        "Circles are not in CVAT's YOLO export: 329 empty texts became 329 pictures without a ball.",
        "yolo",
        {"obj.names": "ball\n", "obj_train_data/frame_000001.txt": "", "obj_train_data/frame_000002.txt": ""},
        says="nobody may have looked at it",
    ),
    Report(
        f"{CVAT}/issues/7643",
        "The same in its Pascal VOC export: files without objects became pictures without a ball.",
        "voc",
        {
            "Annotations/frame_000001.xml": "<annotation><filename>frame_000001.PNG</filename><source><database>Unknown"
            "</database><annotation>Unknown</annotation><image>Unknown</image></source></annotation>"
        },
        says="nobody may have looked at it",
    ),
    Report(
        f"{CVAT}/issues/8322",
        "Turned boxes are not in CVAT's YOLO 1.1 export: blank texts became no ball.",
        "yolo",
        {
            "obj.names": "ball\n",
            "obj_train_data/frame_000001.txt": f"0 {BALL}\n",
            "obj_train_data/frame_000002.txt": "",
        },
        [AT],
        "nobody may have looked at it",
    ),
    Report(
        f"{CVAT}/issues/1251",
        "Frames that nobody annotated are exported too (CVAT for images): they became no ball.",
        "cvat",
        {
            "annotations.xml": '<annotations><image id="1" name="frame_000001.png"><box label="ball" '
            'xtl="630" ytl="170" xbr="650" ybr="190"/></image>'
            '<image id="2" name="frame_000002.png"></image></annotations>'
        },
        [AT],
        "nobody may have looked at it",
    ),
    Report(
        f"{CVAT}/issues/1294",
        "With frame steps there are empty texts of the pictures' numbers, full ones of others: both were taken.",
        "yolo",
        {
            "obj.names": "ball\n",
            "obj_train_data/000000.txt": "",
            "obj_train_data/000005.txt": "",
            "obj_train_data/frame_000000.txt": f"0 {BALL}\n",
            "obj_train_data/frame_000001.txt": f"0 {BALL}\n",
        },
        says="pictures are named in two ways",
    ),
    Report(
        f"{CVAT}/issues/3879",
        "Boxes between keyframes are exported at the place of the keyframe before. (Tracks were refused altogether.)",
        "cvat",
        {"annotations.xml": track((1, 640, 1, 0), (2, 640, 0, 0), (3, 680, 1, 0))},
        [AT, (30_000, "visible", 679.5, 179.5)],
        "only repeats the keyframe before",
    ),
    Report(
        f"{CVAT}/issues/8514",
        "A track that is not ended has a box in every frame up to the end of the video. (Tracks were refused.)",
        "cvat",
        {"annotations.xml": track((1, 640, 1, 0), *((frame, 640, 0, 0) for frame in range(2, 60)))},
        [AT],
        "only repeats the keyframe before",
    ),
    Report(
        f"{CVAT}/issues/900",
        "The last entry of a track, `outside`, is no ball's place and says nothing of others. (Tracks were refused.)",
        "cvat",
        {"annotations.xml": track((1, 640, 1, 0), (2, 650, 0, 0), (3, 660, 1, 0), (4, 660, 1, 1))},
        [AT, (20_000, "visible", 649.5, 179.5), (30_000, "visible", 659.5, 179.5)],
        "1 shape of an object that is outside",
    ),
    Report(
        f"{CVAT}/issues/4185",
        "Pictures of one name in two folders share an image id: the second one's ball was put into the first.",
        "coco",
        {
            "a.json": coco(
                [ball(), ball(id=2, bbox=[10, 10, 20, 20])],
                [picture(1, "left/frame_000001.png"), picture(1, "right/frame_000001.png")],
                BALLS,
            )
        },
        says="used twice",
    ),
    Report(
        f"{CVAT}/issues/298",
        "Image ids are text in the list, numbers in the annotations: every picture became empty.",
        "coco",
        {"a.json": coco([ball()], [picture("1")], BALLS)},
        [AT],
    ),
    Report(
        "https://github.com/pylabel-project/pylabel/issues/6",
        "category_id is text, and iscrowd is null.",
        "coco",
        {"a.json": coco([ball(category_id="1", iscrowd=None)], [picture()], BALLS)},
        [AT],
    ),
    Report(
        f"{STUDIO}/issues/6609",
        "Categories count from 0.",
        "coco",
        {
            "result.json": coco([ball(category_id=0)], [picture(0)], [{"id": 0, "name": "ball"}]).replace(
                '"image_id": 1', '"image_id": 0'
            )
        },
        [AT],
    ),
    Report(
        f"{STUDIO}/issues/9366",
        "file_name is the place where Label Studio keeps the picture, with eight hex digits before its name.",
        "coco",
        {
            "result.json": coco(
                [ball()], [picture(1, "../../label-studio/data/media/upload/3/1a2b3c44-frame_000001.png")], BALLS
            )
        },
        [AT],
    ),
    Report(
        f"{STUDIO}/issues/6416",
        "classes.txt and notes.json of one export number the classes differently: the first one was believed.",
        "yolo",
        {
            "classes.txt": "racket\nball\n",
            "notes.json": '{"categories": [{"id": "1", "name": "racket"}, {"id": "0", "name": "ball"}]}',
            "labels/1a2b3c44-frame_000001.txt": f"0 {BALL}\n",
        },
        says="lists of class names disagree",
    ),
    Report(
        "https://github.com/obss/sahi/issues/524",
        "Classes in the texts count from 1, the list from 0: persons (1) were taken for the ball, balls (2) rejected.",
        "yolo",
        {
            "data.yaml": "names: [person, ball]\nnc: 2\n",
            "train/frame_000001.txt": f"2 {BALL}\n1 0.3 0.5 0.2 0.4\n",
            "train/frame_000002.txt": "1 0.31 0.5 0.2 0.4\n",
        },
        says="count from 1",
    ),
    Report(
        "https://github.com/ultralytics/yolov5/issues/1538",
        "A class beyond the list, in one line: it is left out, the rest is kept.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": f"16 0.1 0.1 0.1 0.1\n0 {BALL}\n"},
        [AT],
        "class 16 is not 'ball'",
    ),
    Report(
        "https://github.com/HumanSignal/labelImg/issues/465",
        "LabelImg overwrote classes.txt with fewer names: a class that is not in it is not the ball.",
        "yolo",
        {"classes.txt": "person\n", "frame_000001.txt": f"1 {BALL}\n"},
        says="no class 'ball' among ['person']",
    ),
    Report(
        "https://github.com/HumanSignal/labelImg/issues/721",
        "A list that LabelImg left beside the texts contradicts that of the data set: the persons became balls.",
        "yolo",
        {
            "data.yaml": "names: [person, ball]\n",
            "train/classes.txt": "ball\nperson\n",
            "train/frame_000001.txt": f"1 {BALL}\n0 0.3 0.5 0.2 0.4\n",
        },
        says="lists of class names disagree",
    ),
    Report(
        "https://github.com/pjreddie/darknet/issues/1870",
        "A list of darknet of its own name, in Latin-1: it was not found.",
        "yolo",
        {"schläger.names": "schläger\nball\n".encode("latin-1"), "frame_000001.txt": f"1 {BALL}\n"},
        [AT],
        "read as Latin-1",
    ),
    Report(
        "https://github.com/ultralytics/ultralytics/issues/1357",
        "Confidence and number of a track follow the box: they were taken for the corner of a polygon.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": f"0 {BALL} 0.83 17\n"},
        [AT],
    ),
    Report(
        "https://github.com/chuanenlin/drone-net/issues/1",
        "Two corners in shares where centre and sides belong: a ball of 210 px was taken.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": "0 0.49 0.24 0.51 0.26\n"},
        says="larger than half of the picture",
    ),
    Report(
        "https://github.com/GreatV/labelme2yolo/issues/25",
        "Nine columns are a polygon (labelme2yolo): they were refused as no YOLO.",
        "yolo",
        {
            "data.yaml": "names: [ball]\n",
            "frame_000001.txt": "0 0.4921875 0.2361111 0.5078125 0.2361111 0.5078125 0.2638889 0.4921875 0.2638889\n",
        },
        [AT],
    ),
    Report(
        "https://github.com/ultralytics/yolov5/issues/10196",
        "A segment in pixels, with a confidence at its end.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": "0 630 170 650 170 650 190 630 190 0.464866\n"},
        says="are these pixels",
    ),
    Report(
        "https://github.com/ultralytics/yolov5/issues/4873",
        "x, y, width and height in pixels from OpenCV.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": "0 164 487 105 35\n"},
        says="are these pixels",
    ),
    Report(
        "https://github.com/AlexeyAB/darknet/issues/785",
        "A wrong conversion of COCO gives heights below 0.",
        "yolo",
        {"data.yaml": "names: [ball]\n", "frame_000001.txt": "0 0.004953 0.311290 0.009906 -0.299441\n"},
        says="outside the picture",
    ),
    Report(
        "https://github.com/cocodataset/cocoapi/issues/474",
        "A box in shares of the picture in COCO became a ball of 0.8 px in the corner.",
        "coco",
        {
            "a.json": coco(
                [ball(bbox=[0.230576753616333, 0.5892798900604248, 1.7554702758789062, 1.3417853116989136], area=0)],
                [picture()],
                BALLS,
            )
        },
        says="shares of the picture",
    ),
    Report(
        "https://github.com/weecology/DeepForest/pull/1215",
        "Corners where COCO has a corner and sides: a ball of 230 px beside the place was taken.",
        "coco",
        {"a.json": coco([ball(bbox=[630, 170, 650, 190])], [picture()], BALLS)},
        says="the box and its area contradict each other",
    ),
    Report(
        "https://github.com/Chang-Chia-Chi/TrackNet-Badminton-Tracking-tensorflow2/issues/8",
        "Shares of the picture under the header of pixels put every ball into the corner.",
        "tracknet",
        {"match1.csv": "Frame,Visibility,X,Y\n0,1,0.461,0.451\n1,1,0.463,0.45\n"},
        says="shares of the picture",
    ),
    Report(
        "https://github.com/maudzung/TTNet-Real-time-Analysis-System-for-Table-Tennis-Pytorch/issues/34",
        "Positions -1, -1 are those of no ball there, and 0, 0 in other tables: that was a ball in the corner.",
        "tracknet",
        {"match1.csv": "Frame,Visibility,X,Y\n0,1,0,0\n1,1,639.5,179.5\n2,1,-1,-1\n"},
        [AT],
        "0, 0 stands for no position",
    ),
    Report(
        "https://github.com/mareksubocz/TrackNet/issues/2",
        "A folder with the table of every video: frames of the second one were added to the first's.",
        "tracknet",
        {
            "csvs/vid1.csv": "Frame,Visibility,X,Y\n0,1,100,100\n",
            "csvs/vid2.csv": "Frame,Visibility,X,Y\n0,1,500,500\n1,1,510,500\n",
        },
        says="the same pictures are in several files",
    ),
]


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: "-".join(report.link.split("/")[3:]) + f"-{report.kind}")
def test_what_was_reported_is_read_right_or_refused(report: Report, tmp_path: Path) -> None:
    made = import_files(tmp_path, report.kind, report.files, *report.flags)
    assert made.code == (0 if report.rows else 2), made
    assert [row[:2] for row in made.rows] == [row[:2] for row in report.rows]
    for found, wanted in zip(made.rows, report.rows, strict=True):
        assert found[2:] == pytest.approx(wanted[2:], abs=0.02)
    assert report.says in made.said


def test_each_report_is_named_with_what_was_wrong() -> None:
    assert len({report.link for report in REPORTS}) >= 20
    assert all(report.link.startswith("https://github.com/") and report.before[-1] in ".)" for report in REPORTS)


YOLO_SET = {"labels/frame_000001.txt": f"0 {BALL}", "data.yaml": "names: [ball]\n"}
FROM_1 = "frame,t_us\n" + "".join(f"{k},{1000 * k}\n" for k in range(1, 50))


def png(width: int, height: int) -> bytes:
    fine, content = cv2.imencode(".png", np.zeros((height, width), np.uint8))
    assert fine
    return content.tobytes()


def numbered(first: int, last: int) -> dict[str, str]:
    """A text of YOLO for each picture from `first` to `last`, and the list of classes."""
    return {**{f"frame_{k:06d}.txt": f"0 {BALL}" for k in range(first, last + 1)}, "classes.txt": "ball\n"}


@pytest.mark.parametrize(("size", "code"), [((640, 640), 2), ((640, 360), 0), ((1280, 720), 0)])
@pytest.mark.parametrize("place", ["images/", "labels/"])
def test_the_pictures_beside_yolo_labels_tell_whether_they_were_padded(
    size: tuple[int, int], code: int, place: str, tmp_path: Path
) -> None:
    """https://github.com/ultralytics/yolov5/issues/4952: labels of padded pictures were 79 px off."""
    files = {
        "labels/frame_000001.txt": f"0 {BALL}",
        "data.yaml": "names: [ball]\n",
        f"{place}frame_000001.PNG": png(*size),
    }
    made = import_files(tmp_path, "yolo", files)
    assert made.code == code
    assert made.rows == [pytest.approx(AT)] if not code else "expected 1280x720, got 640x640" in made.said


def test_stretched_pictures_beside_yolo_labels_are_taken_as_told(tmp_path: Path) -> None:
    files = {
        "labels/frame_000001.txt": f"0 {BALL}",
        "data.yaml": "names: [ball]\n",
        "images/frame_000001.png": png(64, 64),
    }
    assert import_files(tmp_path, "yolo", files, "--scale-pictures").times == [10_000]


@pytest.mark.parametrize(
    ("first", "last", "times", "said"),
    [
        (
            0,
            4,
            "frame,t_us\n" + "".join(f"{k},{1000 * k}\n" for k in range(1, 50)),
            "from 0, and times are counted from 1",
        ),
        (1, 5, "t_us\n0\n1000\n2000\n3000\n4000\n", "numbered from 1, and times are counted from 0"),
    ],
)
def test_pictures_and_times_that_count_differently_are_refused_as_a_whole(
    first: int, last: int, times: str, said: str, tmp_path: Path
) -> None:
    """https://github.com/favyen/miris/issues/4: four of five labels were stored one picture early."""
    made = import_files(tmp_path, "yolo", numbered(first, last), times=times)
    assert made.code == 2 and said in made.said


def test_as_many_times_as_pictures_whose_numbers_have_gaps_are_not_counted_by_row(tmp_path: Path) -> None:
    files = {f"frame_{k:06d}.txt": f"0 {BALL}" for k in (0, 10, 20)} | {"classes.txt": "ball\n"}
    made = import_files(tmp_path, "yolo", files, times="t_us\n0\n5000\n10000\n")
    assert made.code == 2 and "numbers have gaps" in made.said


def test_names_are_compared_as_letters_and_endings_in_any_case(tmp_path: Path) -> None:
    """https://github.com/llmsresearch/paperbanana/issues/234: macOS writes a letter and its dots as two characters."""
    name = "Aufschl\u00e4ge_000001"
    times = f"name,t_us\n{unicodedata.normalize('NFD', name)}.PNG,10000\n"
    files = {f"{name}.TXT": f"1 {BALL}", "Classes.TXT": "racket\nb\u00e4ll\n"}
    made = import_files(tmp_path, "yolo", files, "--ball-class", unicodedata.normalize("NFD", "B\u00e4ll"), times=times)
    assert made.rows == [pytest.approx(AT)]


@pytest.mark.parametrize(("kind", "name"), [("tracknet", "A.CSV"), ("coco", "A.JSON"), ("voc", "A.XML")])
def test_a_file_whose_ending_is_in_capitals_is_looked_into(kind: str, name: str, tmp_path: Path) -> None:
    assert f"no {Path(name).suffix.lower()} files here" not in import_files(tmp_path, kind, {name: "?"}).said


def test_a_folder_of_nothing_is_no_success(tmp_path: Path) -> None:
    made = import_files(tmp_path, "yolo", {"classes.txt": "ball\n"})
    assert made.code == 2 and "nothing to import" in made.error and "none in 0 files" in made.error


def test_a_compressed_file_is_called_so(tmp_path: Path) -> None:
    made = import_files(tmp_path, "coco", {"a.json": b"\x1f\x8b\x08" + bytes(20)})
    assert made.code == 2 and "compressed (gzip)" in made.said


def test_the_size_of_tracknet_s_pictures_is_stated(tmp_path: Path) -> None:
    table = {"a.csv": "Frame,Visibility,X,Y\n1,1,319.5,89.5\n"}
    made = import_files(tmp_path, "tracknet", table, "--picture-size", "640x360")
    assert (SENSOR.width_px, SENSOR.height_px) == (1280, 720) and made.rows == [
        pytest.approx((10_000, "visible", 639.5, 179.5))
    ]


def test_a_yaml_with_tags_still_names_the_classes(tmp_path: Path) -> None:
    files = {"frame_000001.txt": f"1 {BALL}", "data.yaml": "!Set\nnames: !!python/tuple [racket, ball]\n"}
    assert import_files(tmp_path, "yolo", files).rows == [pytest.approx(AT)]


@pytest.mark.parametrize(
    ("text", "flags", "rows"),
    [
        ("t_us,x,y\n10000,639.5,179.5\n20000,,\n", (), [AT]),
        ("t,x,y\n0.01,639.5,179.5\n0.02,1,2\n", (), [AT, (20_000, "visible", 1, 2)]),
        ("Time [ms];x;y\n10;639,5;179,5\n", (), [AT]),
        ("dt_us,x,y\n4000,1,2\n6000,639.5,179.5\n", (), [(4_000, "visible", 1, 2), AT]),
        ("frame,x,y,r\n1,639.5,179.5,7\n", (), [AT]),
        ("t_us,x,y\n10000,319.5,89.5\n", ("--picture-size", "640x360"), [AT]),
        ("t_us,x,y\n10000,5000,89.5\n", (), []),
        ("t_us,x,y\n0,0,0\n10000,639.5,179.5\n20000,0.0,0.0\n", (), [AT]),
        ("t_us,t_s,x,y\n10000,0.01,5,5\n", (), []),
        ("t_us,cx,cy,w,h\n10000,639.5,179.5,20,20\n", (), [AT]),
        ("t_us,x,y,width,height\n10000,639.5,179.5,1280,720\n", (), [AT]),
    ],
)
def test_a_track_of_another_tool_becomes_labels(
    text: str, flags: tuple[str, ...], rows: list[Row], tmp_path: Path
) -> None:
    made = import_files(tmp_path, "csv", {"a.csv": text}, *flags)
    assert made.code == (0 if rows else 2)
    assert made.rows == [pytest.approx(row) for row in rows]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        # The corner of a box: was taken for the centre of the ball, half its size beside it.
        ("t_us,x,y,w,h\n10000,629.5,169.5,20,20\n", "may be its corner: expected its centre, as cx, cy"),
        # Whole milliseconds: were taken for microseconds, all labels in the first 30 us.
        ("time,x,y\n10.0,1,2\n20.0,3,4\n30.0,5,6\n", "as us they are less than 100 us apart; name their column"),
    ],
)
def test_a_track_whose_columns_mean_two_things_is_refused(text: str, said: str, tmp_path: Path) -> None:
    made = import_files(tmp_path, "csv", {"a.csv": text})
    assert made.code == 2 and not made.rows and said in made.said


@pytest.mark.parametrize("turned", [False, True])
def test_labels_whose_rows_count_from_the_bottom_are_noted(turned: bool, tmp_path: Path) -> None:
    """They were taken as they were: no picture is there to tell, but the events are."""
    places = [(10_000 * k, 300 + 20 * k, 100 + 10 * k) for k in range(10)]
    t, x, y = np.repeat(places, 20, axis=0).T + np.tile(np.arange(20), 10)
    events = Events.from_columns(t, x, y, t % 2 == 0, SENSOR)
    rows = "".join(f"{t_us},{x_px},{719 - y_px if turned else y_px}\n" for t_us, x_px, y_px in places)
    (tmp_path / "a.csv").write_text("t_us,x,y\n" + rows)
    found = import_labels("csv", tmp_path / "a.csv", ImportContext(SENSOR, events_between=events.between))
    said = "With y = height - 1 - y 100 events lie there, 0 at the labels"
    assert len(found.labels) == 10 and turned == (said in " ".join(found.notes))


def test_columns_of_a_track_that_nobody_reads_are_named(tmp_path: Path) -> None:
    made = import_files(tmp_path, "csv", {"a.csv": "t_us,id,x,y,w\n10000,7,639.5,179.5,20\n"})
    assert made.rows == [pytest.approx(AT)] and "a.csv: the columns id, w are not read" in made.notes


def test_a_picture_that_was_turned_while_it_was_labelled_is_rejected(tmp_path: Path) -> None:
    value = {"x": 50, "y": 25, "radiusX": 1, "radiusY": 1, "ellipselabels": ["ball"]}
    region = {"type": "ellipselabels", "original_width": SENSOR.width_px, "original_height": SENSOR.height_px}
    tasks = [
        {
            "id": number,
            "data": {"image": f"frame_00000{number}.png"},
            "annotations": [{"result": [{**region, "image_rotation": turned, "value": value}]}],
        }
        for number, turned in ((1, 0), (2, 90))
    ]
    made = import_files(tmp_path, "label-studio", {"a.json": json.dumps(tasks)})
    assert made.rows == [pytest.approx(AT)]
    assert "turned while it was labelled; got 90 degrees" in made.said


def test_a_confidence_that_stands_first_is_no_column(tmp_path: Path) -> None:
    files = {"classes.txt": "ball\n", "frame_000001.txt": f"0 {BALL} 0.9\n", "frame_000002.txt": f"0 0.9 {BALL}\n"}
    made = import_files(tmp_path, "yolo", files)
    assert made.rows == [pytest.approx(AT)] and "the confidence seems to stand first" in made.said


def test_detections_among_yolo_labels_are_counted_by_their_confidence(tmp_path: Path) -> None:
    texts = [f"0 {BALL} 0.9\n", f"0 {BALL} 0.04 3\n", f"0 {BALL} 0.2\n", f"0 {BALL}\n"]
    files = {f"frame_00000{k}.txt": text for k, text in enumerate(texts, start=1)}
    made = import_files(tmp_path, "yolo", {"classes.txt": "ball\n", **files})
    assert len(made.rows) == 4
    assert "3 boxes are detections, with confidences from 0.04, 2 of them below 0.25" in made.said


SMALL = [(10_000 * k, 20 + 40 * k, 20 + 20 * k) for k in range(12)]
"""A ball on its way through pictures of 512x288."""


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("tracknet", "Frame,Visibility,X,Y\n" + "".join(f"{k},1,{x},{y}\n" for k, (_, x, y) in enumerate(SMALL))),
        ("csv", "t_us,x,y\n" + "".join(f"{t_us},{x},{y}\n" for t_us, x, y in SMALL)),
    ],
)
def test_a_track_that_may_be_of_smaller_pictures_names_their_size(kind: str, text: str, tmp_path: Path) -> None:
    said = import_files(tmp_path / "a", kind, {"a.csv": text}).notes
    assert [note for note in said if "all 12 positions lie within 512x288" in note and "--picture-size 512x288" in note]
    stated = import_files(tmp_path / "b", kind, {"a.csv": text}, "--picture-size", "512x288")
    assert len(stated.rows) == 12 and not any("lie within" in note for note in stated.notes)
    larger = text + ("12,1,900,500\n" if kind == "tracknet" else "120000,900,500\n")
    assert not any("lie within" in note for note in import_files(tmp_path / "c", kind, {"a.csv": larger}).notes)
