"""More public reports about label files of other tools, each with a small input made here, through the command.

`before` says what an import did when the report was first tried.
"""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.labels.formats.import_command import Report, Row, import_files

BALL = "0.5 0.25 0.015625 0.0277778"
AT: Row = (10_000, "visible", 639.5, 179.5)
GITHUB = "https://github.com"
NAMES = {"classes.txt": "ball\n"}


def picture(width: int, height: int, kind: str = "PNG", orientation: int = 1) -> bytes:
    """A black picture that EXIF may turn."""
    content, black = io.BytesIO(), Image.fromarray(np.zeros((height, width), np.uint8))
    exif = black.getexif()
    exif[0x112] = orientation
    black.save(content, kind, exif=exif)
    return content.getvalue()


def coco(*balls: dict, categories: tuple[dict, ...] = ({"id": 1, "name": "ball"},), names: tuple[str, ...]) -> str:
    images = [{"id": number, "file_name": name} for number, name in enumerate(names, start=1)]
    usual = {"image_id": 1, "category_id": 1, "bbox": [630, 170, 20, 20], "area": 400, "iscrowd": 0}
    annotations = [{"id": number, **usual, **ball} for number, ball in enumerate(balls, start=1)]
    return json.dumps({"images": images, "annotations": annotations, "categories": categories})


def studio(**value: float) -> str:
    """A task of Label Studio with one rectangle, in percent."""
    region = {
        "original_width": 1280,
        "original_height": 720,
        "image_rotation": 0,
        "value": {"rotation": 0, "rectanglelabels": ["ball"], **value},
        "from_name": "label",
        "to_name": "image",
        "type": "rectanglelabels",
    }
    task = {"id": 1, "data": {"image": "/data/upload/18/0f6142fb-frame_000001.png"}}
    return json.dumps([{**task, "annotations": [{"id": 1, "was_cancelled": False, "result": [region]}]}])


def voc(edges: str) -> str:
    return (
        "<annotation><filename>frame_000001.png</filename><size><width>1280</width><height>720</height></size>"
        f"<object><name>ball</name><bndbox>{edges}</bndbox></object></annotation>"
    )


def box(frame: int, x: float, outside: int = 0) -> str:
    return (
        f'<box frame="{frame}" outside="{outside}" occluded="0" keyframe="1" xtl="{x - 10}" ytl="170" xbr="{x + 10}" '
        'ybr="190"/>'
    )


def video(*boxes: str, filtered: str = "") -> str:
    task = f"<meta><task><frame_filter>{filtered}</frame_filter></task></meta>" if filtered else ""
    track = f'<track id="0" label="ball">{"".join(boxes)}</track>'
    return f"<annotations><version>1.1</version>{task}{track}</annotations>"


CLIP = "Frame,Visibility,X,Y\n1,1,319.5,89.5\n"
SHOWN = {"labels/frame_000001.txt": f"0 {BALL}", "data.yaml": "names: [ball]\n"}
MOT = "0 1 630 170 20 20 -1 -1 -1 -1\n1 1 640 170 20 20 -1 -1 -1 -1\n"
DOTS = {"obj.names": "ball\n", "labels/2024-01-09_13.52.57.txt": f"0 {BALL}", "labels/2024-01-09_22.21.52.txt": ""}

REPORTS = [
    Report(
        f"{GITHUB}/cvat-ai/cvat/issues/1334",
        "Right: with frame steps, annotations name pictures that the list has not.",
        "coco",
        {"a.json": coco({}, {"image_id": 10}, names=("frame_000001.png",))},
        [AT],
        "an image that is not listed; got 10",
    ),
    Report(
        f"{GITHUB}/cvat-ai/cvat/issues/1059",
        "Wrong: refused. The picture is stored upright, shown and annotated in landscape by its EXIF.",
        "yolo",
        {**SHOWN, "images/frame_000001.jpg": picture(720, 1280, "JPEG", 6)},
        [AT],
    ),
    Report(
        f"{GITHUB}/HumanSignal/labelImg/issues/376",
        "Silently wrong: stored in the sensor's shape, shown and annotated upright.",
        "yolo",
        {**SHOWN, "images/frame_000001.jpg": picture(1280, 720, "JPEG", 8)},
        says="expected 1280x720, got 720x1280",
    ),
    Report(
        f"{GITHUB}/cvat-ai/cvat/issues/8839",
        "Right: names of a video's pictures have no ending.",
        "cvat",
        {
            "a.xml": '<annotations><image id="1" name="frame_000001"><box label="ball" xtl="630" ytl="170" xbr="650" '
            'ybr="190"/></image></annotations>'
        },
        [AT],
    ),
    Report(
        f"{GITHUB}/cvat-ai/cvat/issues/764",
        "Right: every fifth picture of a video, with its own numbers.",
        "cvat",
        {"a.xml": video(box(0, 640), box(5, 660), box(10, 660, 1), filtered="step=5")},
        [(0, "visible", 639.5, 179.5), (50_000, "visible", 659.5, 179.5)],
        "their numbers are kept",
    ),
    Report(
        f"{GITHUB}/voxel51/fiftyone/pull/1330",
        "Right: CVAT counts from 0, the table of times from 1.",
        "cvat",
        {"a.xml": video(box(0, 640), box(1, 660), box(2, 660, 1))},
        says="numbered from 0, and times are counted from 1",
        times="frame,t_us\n" + "".join(f"{k},{10_000 * k}\n" for k in range(1, 50)),
    ),
    Report(
        f"{GITHUB}/cvat-ai/cvat/issues/3940",
        "Refused with a wrong reason: the class is not a finite number.",
        "yolo",
        {**NAMES, "gt/gt.txt": "1, 1, 162, 367, 93, 110, 1, 1, 1\n"},
        says="looks like a track of MOT",
    ),
    Report(
        f"{GITHUB}/mikel-brostrom/boxmot/issues/137",
        "Refused with a wrong reason: pixels for shares in one row, a class that is not the ball in the next.",
        "yolo",
        {**NAMES, "video_1.txt": MOT},
        says="looks like a track of MOT",
    ),
    Report(
        f"{GITHUB}/ultralytics/ultralytics/pull/1358",
        "Wrong: track 1 was read as a triangle, and -1 (no track) as pixels; both were rejected.",
        "yolo",
        {
            **NAMES,
            "frame_000001.txt": f"0 {BALL} 0.87 1",
            "frame_000002.txt": f"0 {BALL} 0.9 -1",
            "frame_000003.txt": f"0 {BALL} 0.9 12",
        },
        [AT, (20_000, *AT[1:]), (30_000, *AT[1:])],
    ),
    Report(
        f"{GITHUB}/ultralytics/ultralytics/issues/22256",
        "Right: the number of a track without a confidence.",
        "yolo",
        {**NAMES, "frame_000001.txt": f"0 {BALL} 7"},
        [AT],
    ),
    Report(
        f"{GITHUB}/RizwanMunawar/yolov7-object-tracking/issues/39",
        "Right: track, class, corners and centre are no line of YOLO.",
        "yolo",
        {**NAMES, "frame_000001.txt": "8 0 0.649219 0.322266 0.659375 0.355469 0.978906 0.500000"},
        says="class 8 is not 'ball'",
    ),
    Report(
        f"{GITHUB}/ultralytics/yolov5/issues/10632",
        "Right: a corner of a segment lies 0.2 % outside.",
        "yolo",
        {**NAMES, "frame_000001.txt": "0 0.98 0.5 1.0021 0.5 1.0021 0.53 0.98 0.53"},
        [(10_000, "visible", 1268.044, 370.3)],
    ),
    Report(
        f"{GITHUB}/ultralytics/ultralytics/issues/20138",
        "Right: boxes beyond the picture.",
        "yolo",
        {**NAMES, "frame_000001.txt": "0 1.0710385 1.0634356 1.857923 1.873129"},
        says="outside the picture",
    ),
    Report(
        f"{GITHUB}/open-edge-platform/datumaro/issues/1328",
        "Right: dots within the names, which are no endings.",
        "yolo",
        DOTS,
        [AT, (20_000, "no_ball", None, None)],
        times="name,t_us\n2024-01-09_13.52.57.png,10000\n2024-01-09_22.21.52.png,20000\n",
    ),
    Report(
        f"{GITHUB}/open-edge-platform/datumaro/issues/716",
        "Right: edges with fractions.",
        "voc",
        {"a.xml": voc("<xmin>630.5</xmin><ymin>170.5</ymin><xmax>650.5</xmax><ymax>190.5</ymax>")},
        [(10_000, "visible", 640.0, 180.0)],
    ),
    Report(
        f"{GITHUB}/CVHub520/X-AnyLabeling/issues/224",
        "Right: the edges in another order.",
        "voc",
        {"a.xml": voc("<xmin>630.5</xmin><xmax>650.5</xmax><ymin>170.5</ymin><ymax>190.5</ymax>")},
        [(10_000, "visible", 640.0, 180.0)],
    ),
    Report(
        f"{GITHUB}/EdjeElectronics/TensorFlow-Object-Detection-API-Tutorial-Train-Multiple-Objects-Windows-10/issues/522",
        "Right: a pair of numbers where one belongs.",
        "voc",
        {"a.xml": voc("<xmin>(88, 100)</xmin><ymin>170</ymin><xmax>650</xmax><ymax>190</ymax>")},
        says="got '(88, 100)'",
    ),
    Report(
        f"{GITHUB}/roboflow/supervision/pull/2276",
        "Right: categories that count from 0.",
        "coco",
        {"a.json": coco({"category_id": 0}, categories=({"id": 0, "name": "ball"},), names=("frame_000001.png",))},
        [AT],
    ),
    Report(
        f"{GITHUB}/HumanSignal/label-studio/issues/7294",
        "Right: file names with the folders of Windows.",
        "coco",
        {"a.json": coco({}, names=("..\\..\\label-studio\\media\\upload\\4\\cb0618f6-frame_000001.png",))},
        [AT],
    ),
    Report(
        f"{GITHUB}/CVHub520/X-AnyLabeling/issues/700",
        "Right: some names with a folder, others without.",
        "coco",
        {"a.json": coco({}, {"image_id": 2}, names=("1.jpg", "..\\label\\2.jpg"))},
        [AT, (20_000, *AT[1:])],
    ),
    Report(
        f"{GITHUB}/HumanSignal/label-studio/issues/5223",
        "Right: a box that is turned by 90 degrees round its corner, in percent of a picture that is no square.",
        "label-studio",
        {"a.json": studio(x=50, y=25, width=1.5625, height=2.7777778, rotation=90)},
        [(10_000, "visible", 629.5, 189.5)],
    ),
    Report(
        f"{GITHUB}/HumanSignal/label-studio/issues/3140",
        "Refused with a wrong reason: the box is empty. It is drawn upwards.",
        "label-studio",
        {"a.json": studio(x=49.21875, y=26.3888889, width=1.5625, height=-2.7777778)},
        [AT],
    ),
    Report(
        f"{GITHUB}/yastrebksv/TrackNet/issues/8",
        "Silently wrong: pixels of pictures of 640x360 were taken for the sensor's.",
        "tracknet",
        {
            "Label.csv": "file name,visibility,x-coordinate,y-coordinate,status\n0001.jpg,1,319.5,89.5,0\n",
            "0001.jpg": picture(640, 360, "JPEG"),
        },
        says="expected 1280x720, got 640x360; --picture-size 640x360",
    ),
    Report(
        f"{GITHUB}/alenzenx/TrackNetV3/issues/16",
        "Silently wrong: the same, with the pictures of the clip in a folder of their own.",
        "tracknet",
        {"match1/csv/1_01_ball.csv": CLIP, "match1/frame/1_01/1.png": picture(512, 288)},
        says="expected 1280x720, got 512x288",
    ),
    Report(
        f"{GITHUB}/natcap/invest/issues/146",
        "Refused with a wrong reason: a comma at the end of each line but that of the names.",
        "csv",
        {"a.csv": "t_us,x,y\n10000,639.5,179.5,\n"},
        [AT],
    ),
    Report(
        f"{GITHUB}/pandas-dev/pandas/issues/10646",
        "Right: a column without a name that counts the rows.",
        "csv",
        {"a.csv": ",t_us,x,y\n0,10000,639.5,179.5\n"},
        [AT],
    ),
    Report(
        f"{GITHUB}/pandas-dev/pandas/issues/2697",
        "Right: a time with an exponent.",
        "csv",
        {"a.csv": "t_us,x,y\n1E+4,639.5,179.5\n"},
        [AT],
    ),
    Report(
        f"{GITHUB}/Arize-ai/openinference/issues/210",
        "Right: NaN in JSON, which is none.",
        "coco",
        {"a.json": coco({"bbox": [float("nan"), 1, 2, 3]}, {}, names=("frame_000001.png",))},
        [AT],
        "not a finite number; got nan",
    ),
]

DLC = "scorer,Mona,Mona,Mona,Mona\nbodyparts,ball,ball,head,head\ncoords,x,y,x,y\n"
ROW = "639.5,179.5,1,1\n"
ANALYSED = "scorer,R,R,R\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n0,1,2,0.01\n1,639.5,179.5,0.99\n"
DEEPLABCUT = [
    ("issues/486", DLC + f"labeled-data/moth/frame_000001.png,{ROW}labeled-data/moth/frame_000002.png,,,2,2\n", ""),
    (
        "pull/1769: the name in three columns",
        f"{DLC.replace(',', ',,,', 1).replace('bodyparts,', 'bodyparts,,,').replace('coords,', 'coords,,,')}"
        f"labeled-data,moth,frame_000001.png,{ROW}",
        "",
    ),
    ("issues/1361: found in a video", ANALYSED, "1 positions of a likelihood below 0.6"),
    (
        "issues/3024: individuals",
        DLC.replace("bodyparts", "individuals,single,single,rat,rat\nbodyparts") + f"frame_000001.png,{ROW}",
        "",
    ),
]
"""Read since: were refused as `not a label table`."""


@pytest.mark.parametrize(("report", "text", "said"), DEEPLABCUT, ids=lambda value: value[:12])
def test_tables_of_deeplabcut_are_read(report: str, text: str, said: str, tmp_path: Path) -> None:
    made = import_files(tmp_path, "csv", {"CollectedData_Mona.csv": text})
    assert made.rows == [pytest.approx(AT)] and said in made.said, report


@pytest.mark.parametrize(("flags", "rows"), [((), []), (("--ball-class", "nose"), [(10_000, "visible", 639.5, 179.5)])])
def test_the_ball_of_deeplabcut_is_named(flags: tuple[str, ...], rows: list[Row], tmp_path: Path) -> None:
    made = import_files(tmp_path, "csv", {"a.csv": DLC.replace("ball", "nose") + f"frame_000001.png,{ROW}"}, *flags)
    assert made.rows == [pytest.approx(row) for row in rows]
    assert flags or "no body parts are called 'ball'; expected one, got nose, head" in made.said


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: "-".join(report.link.split("/")[3:]))
def test_what_was_reported_is_read_right_or_refused(report: Report, tmp_path: Path) -> None:
    made = import_files(tmp_path, report.kind, report.files, *report.flags, times=report.times)
    assert made.code == (0 if report.rows else 2), made
    assert made.rows == [pytest.approx(row, abs=0.01) for row in report.rows]
    assert report.says in made.said


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"0 {BALL} 0.87 0.93", "neither a box with a confidence and the number of a track nor a triangle"),
        ("0 0.49 0.24 0.51 0.24 0.5 0.26", ""),
    ],
)
def test_seven_columns_of_yolo_are_a_track_a_triangle_or_refused(line: str, said: str, tmp_path: Path) -> None:
    made = import_files(tmp_path, "yolo", {**NAMES, "frame_000001.txt": line})
    assert made.code == (2 if said else 0) and said in made.said
    assert made.rows == ([] if said else [pytest.approx((10_000, "visible", 639.5, 177.1), abs=0.01)])


@pytest.mark.parametrize("size", [(640, 360), (1280, 720)])
def test_a_clip_of_tracknet_is_scaled_as_stated_or_fits_the_sensor(size: tuple[int, int], tmp_path: Path) -> None:
    files = {"csv/1_01_ball.csv": CLIP, "frame/1_01/1.png": picture(*size)}
    stated = ("--picture-size", "640x360") if size == (640, 360) else ()
    made = import_files(tmp_path, "tracknet", files, *stated)
    assert made.rows == [pytest.approx(AT if stated else (10_000, "visible", 319.5, 89.5))]
