"""Small exports as other tools write them, with their faults: what the command takes, and what it says."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.labels.formats.import_command import Row, import_files

V, P, O, N = "visible", "partly_occluded", "occluded", "no_ball"  # noqa: E741
BALL = "0 0.5 0.25 0.015625 0.0277778\n"
"""10 px of radius at (639.5, 179.5) in YOLO."""
AT: Row = (10_000, V, 639.5, 179.5)
YAML = "names: [ball]\n"


@dataclass(frozen=True)
class Case:
    """Files, and what has to come of them."""

    name: str
    kind: str
    files: Mapping[str, str | bytes]
    rows: list[Row] = field(default_factory=list)
    says: tuple[str, ...] = ()
    """Of what was not taken, or noted."""
    flags: tuple[str, ...] = ()
    times: str | None = None
    cameras: tuple[str, ...] = ("camera",)


def coco(
    annotations: list[dict] | None = None, images: list[dict] | None = None, categories: list[dict] | None = None
) -> str:
    ball = {"id": 1, "image_id": 1, "category_id": 1, "bbox": [630, 170, 20, 20], "area": 400, "iscrowd": 0}
    document = {
        "images": images or [{"id": 1, "file_name": "frame_000001.png", "width": 1280, "height": 720}],
        "annotations": [{**ball, **one} for one in ([{}] if annotations is None else annotations)],
        "categories": categories or [{"id": 1, "name": "ball"}, {"id": 2, "name": "person"}],
    }
    return json.dumps(document, indent=1)


def voc(box: tuple, name: str = "frame_000001.png", size: str = "1280,720", extra: str = "", label: str = "ball"):
    width, height = size.split(",")
    box = box or NO_BOX
    edges = "".join(f"<{tag}>{value}</{tag}>" for tag, value in zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True))
    objects = f"<object><name>{label}</name>{extra}<bndbox>{edges}</bndbox></object>"
    return (
        f"<annotation><folder>x</folder><filename>{name}</filename><size><width>{width}</width><height>{height}</height>"
        f"<depth>3</depth></size>{'' if box is NO_BOX else objects}</annotation>"
    )


def cvat(inside: str, name: str = "frame_000001.PNG", number: int = 1, size: str = 'width="1280" height="720"') -> str:
    return f'<annotations><image id="{number}" name="{name}" {size}>{inside}</image></annotations>'


def video(shapes: str, meta: str = "", label: str = "ball") -> str:
    return f'<annotations><version>1.1</version>{meta}<track id="0" label="{label}">{shapes}</track></annotations>'


def box(frame: int, x: float, **more: object) -> str:
    others = {"outside": 0, "occluded": 0, "keyframe": 1, **more}
    words = " ".join(f'{key}="{value}"' for key, value in others.items())
    return f'<box frame="{frame}" {words} xtl="{x - 10}" ytl="170" xbr="{x + 10}" ybr="190" z_order="0"/>'


CVAT_BALL = '<box label="ball" occluded="0" xtl="630" ytl="170" xbr="650" ybr="190"/>'
NO_BOX = ("", "", "", "")
LETTERS = "Frame,Visibility,X,Y\n"

YOLO = [
    Case("names beside, as a list", "yolo", {"data.yaml": YAML, "frame_000001.txt": BALL}, [AT]),
    Case("names two above, as a dict", "yolo", {"data.yaml": "names: {0: ball}", "a/b/frame_1.txt": BALL}, [AT]),
    Case("obj.names of darknet", "yolo", {"obj.names": "ball\n", "obj_train_data/frame_1.txt": BALL}, [AT]),
    Case("notes.json, ids as text", "yolo", {"notes.json": '{"categories": [{"id": "0", "name": "ball"}]}',
         "labels/1a2b3c4d-frame_1.txt": BALL}, [AT]),
    Case("a YAML of any name", "yolo", {"rally.yaml": YAML, "labels/train/frame_1.txt": BALL}, [AT]),
    Case("classes.txt with a byte-order mark and CRLF", "yolo", {"classes.txt": "\ufeffperson\r\nBall\r\n",
         "frame_1.txt": BALL.replace("0", "1", 1)}, [AT]),
    Case("lists that disagree", "yolo", {"classes.txt": "ball\nperson\n", "notes.json":
         '{"categories": [{"id": "1", "name": "ball"}, {"id": "0", "name": "person"}]}', "frame_1.txt": BALL},
         [], ("lists of class names disagree",)),
    Case("nc and names contradict", "yolo", {"data.yaml": "nc: 2\nnames: [ball]\n", "frame_1.txt": BALL}, [],
         ("nc and names contradict",)),
    Case("no list at all", "yolo", {"frame_1.txt": BALL}, [], ("no list of class names", "--ball-class")),
    Case("the number said", "yolo", {"frame_1.txt": BALL}, [AT], flags=("--ball-class", "0")),
    Case("a ball of another name", "yolo", {"classes.txt": "person\nshuttle\n", "frame_1.txt": "1" + BALL[1:]}, [AT],
         flags=("--ball-class", "shuttle")),
    Case("another name, not said", "yolo", {"classes.txt": "person\nshuttle\n", "frame_1.txt": "1" + BALL[1:]}, [],
         ("no class 'ball' among ['person', 'shuttle']",)),
    Case("classes that count from 1", "yolo", {"classes.txt": "person\nball\n", "frame_1.txt": "2" + BALL[1:],
         "frame_2.txt": "1 0.1 0.5 0.2 0.4\n"}, [], ("count from 1",)),
    Case("one odd class among others", "yolo", {"classes.txt": "ball\n", "frame_1.txt": "7" + BALL[1:] + BALL}, [AT],
         ("class 7 is not 'ball'",)),
    Case("an empty text is no ball", "yolo", {"classes.txt": "ball\n", "frame_1.txt": BALL, "frame_2.txt": ""},
         [AT, (20_000, N, None, None)]),
    Case("an empty text of CVAT says nothing", "yolo", {"obj.names": "ball\n", "obj_train_data/frame_1.txt": BALL,
         "obj_train_data/frame_2.txt": ""}, [AT], ("nobody may have looked at it",)),
    Case("unless somebody looked", "yolo", {"obj.names": "ball\n", "obj_train_data/frame_2.txt": ""},
         [(20_000, N, None, None)], flags=("--empty-pictures", "no-ball")),
    Case("only persons is not no ball", "yolo", {"classes.txt": "ball\nperson\n", "frame_1.txt": "1" + BALL[1:],
         "frame_2.txt": "0" + BALL[1:]}, [(20_000, V, 639.5, 179.5)], ("class 1 is not 'ball'",)),
    Case("pixels for shares", "yolo", {"classes.txt": "ball\n", "frame_1.txt": "0 640 180 20 20\n",
         "frame_2.txt": BALL}, [(20_000, V, 639.5, 179.5)], ("are these pixels",)),
    Case("no width, negative, nan", "yolo", {"classes.txt": "ball\n", "frame_1.txt": BALL, "frame_2.txt":
         "0 0.5 0.5 0 0.1\n", "frame_3.txt": "0 0.5 0.5 -0.1 0.1\n", "frame_4.txt": "0 nan 0.5 0.1 0.1\n"}, [AT],
         ("the box is empty", "outside the picture", "not a finite number")),
    Case("a confidence", "yolo", {"classes.txt": "ball\n", "frame_1.txt": BALL.strip() + " 0.83\n"}, [AT]),
    Case("a turned box", "yolo", {"classes.txt": "ball\n",
         "frame_1.txt": "0 0.4921875 0.25 0.5 0.2361111 0.5078125 0.25 0.5 0.2638889\n"}, [AT]),
    Case("a segment with a corner beside the picture", "yolo", {"classes.txt": "ball\n",
         "frame_1.txt": "0 -0.001 0.2 0.01 0.2 0.01 0.22 -0.001 0.22\n"}, [(10_000, V, 5.26, 150.7)]),
    Case("a segment that is no ball", "yolo", {"classes.txt": "ball\n",
         "frame_1.txt": "0 0.1 0.5 0.9 0.5 0.9 0.501 0.1 0.501\n"}, [], ("the polygon is no ball",)),
    Case("a pose of two numbers", "yolo", {"data.yaml": YAML + "kpt_shape: [1, 2]\n",
         "frame_1.txt": BALL.strip() + " 0.5015625 0.25\n"}, [(10_000, V, 641.5, 179.5)]),
    Case("a pose of three, occluded", "yolo", {"data.yaml": YAML + "kpt_shape: [1, 3]\n",
         "frame_1.txt": BALL.strip() + " 0.5 0.25 1\n"}, [(10_000, P, 639.5, 179.5)]),
    Case("a pose of a person", "yolo", {"data.yaml": YAML + "kpt_shape: [17, 3]\n", "frame_1.txt": BALL}, [],
         ("a pose of other keypoints",)),
    Case("a keypoint far from its box", "yolo", {"data.yaml": YAML + "kpt_shape: [1, 3]\n",
         "frame_1.txt": BALL.strip() + " 0.9 0.9 2\n"}, [], ("the keypoint lies far from its box",)),
    Case("hidden files and lists of pictures", "yolo", {"classes.txt": "ball\n", "frame_1.txt": BALL, "train.txt":
         "images/frame_1.png\n", "._frame_2.txt": b"\x00\x05\x16\x07", ".DS_Store": b"\0\0\0\1Bud1"}, [AT]),
    Case("changed copies", "yolo", {"data.yaml": YAML, "frame_1_png.rf.aa11bb22cc33dd44.txt": BALL,
         "frame_1_png.rf.bb22cc33dd44ee55.txt": BALL, "frame_2_png.rf.cc33dd44ee55ff66.txt": BALL},
         [(20_000, V, 639.5, 179.5)], ("copies that a tool has changed",)),
    Case("two cameras in two folders", "yolo", {"classes.txt": "ball\n", "left/frame_1.txt": BALL,
         "right/frame_1.txt": BALL, "right/frame_2.txt": BALL}, [(20_000, V, 639.5, 179.5)],
         ("several pictures have this name",)),
    Case("the other camera's folder", "yolo", {"classes.txt": "ball\n", "right/frame_2.txt": BALL,
         "left/frame_1.txt": BALL}, [AT], ("a picture of camera 'right'",), cameras=("left", "right")),
    Case("our own names of the other camera", "yolo", {"classes.txt": "ball\n", "right_t000000020000us.txt": BALL,
         "left_t000000010000us.txt": BALL}, [AT], ("a picture of camera 'right'",), cameras=("left", "right")),
]  # fmt: skip

COCO = [
    Case("a box", "coco", {"a.json": coco()}, [AT]),
    Case("ids as text", "coco", {"a.json": coco([{"image_id": "1", "category_id": "1"}])}, [AT]),
    Case("ids as text in the list", "coco", {"a.json": coco(images=[{"id": "1", "file_name": "frame_1.png"}])}, [AT]),
    Case("ids as decimals", "coco", {"a.json": coco([{"image_id": 1.0, "category_id": 1.0}])}, [AT]),
    Case("categories from 0", "coco", {"a.json": coco([{"category_id": 0}], categories=[{"id": 0, "name": "ball"}])},
         [AT]),
    Case("another name", "coco", {"a.json": coco(categories=[{"id": 1, "name": "sports ball"}])}, [],
         ("no category 'ball' among ['sports ball']",)),
    Case("another name, said", "coco", {"a.json": coco(categories=[{"id": 1, "name": "sports ball"}])}, [AT],
         flags=("--ball-class", "sports ball")),
    Case("no categories, the number said", "coco", {"a.json": json.dumps({**json.loads(coco()), "categories": []})},
         [AT], flags=("--ball-class", "1")),
    Case("a person is not no ball", "coco", {"a.json": coco([{"category_id": 2}])}, [], ("category 2 is not 'ball'",)),
    Case("a picture without annotation", "coco", {"a.json": coco(images=[{"id": 1, "file_name": "frame_1.png"},
         {"id": 2, "file_name": "frame_2.png"}])}, [AT], ("nobody may have looked at it",)),
    Case("a picture that was looked at", "coco", {"a.json": coco(images=[{"id": 1, "file_name": "frame_1.png"},
         {"id": 2, "file_name": "frame_2.png"}])}, [AT, (20_000, N, None, None)],
         flags=("--empty-pictures", "no-ball")),
    Case("annotations without picture", "coco", {"a.json": coco([{}, {"image_id": 7}])}, [AT],
         ("an image that is not listed",)),
    Case("annotations that belong nowhere make no picture empty", "coco", {"a.json": coco([{"image_id": None}])}, [],
         ("that belong to no picture",), flags=("--empty-pictures", "no-ball")),
    Case("a rejected box is not no ball", "coco", {"a.json": coco([{"bbox": [1, 1, 0, 5]}])}, [],
         ("the box is empty",), flags=("--empty-pictures", "no-ball")),
    Case("an image id twice", "coco", {"a.json": coco(images=[{"id": 1, "file_name": "left/frame_1.png"},
         {"id": 1, "file_name": "right/frame_2.png"}])}, [], ("used twice", "not listed")),
    Case("sides below 0", "coco", {"a.json": coco([{"bbox": [650, 190, -20, -20]}])}, [], ("the box is empty",)),
    Case("nan", "coco", {"a.json": coco([{"bbox": [float("nan"), 190, 20, 20]}])}, [], ("not a finite number",)),
    Case("outside", "coco", {"a.json": coco([{"bbox": [1400, 190, 20, 20]}])}, [], ("the centre is outside",)),
    Case("two corners", "coco", {"a.json": coco([{"bbox": [630, 170, 650, 190], "area": 400}])}, [],
         ("the box and its area contradict",)),
    Case("shares", "coco", {"a.json": coco([{"bbox": [0.49, 0.23, 0.0156, 0.0278], "area": 0.0004}])}, [],
         ("smaller than a pixel",)),
    Case("a crowd", "coco", {"a.json": coco([{"iscrowd": 1, "segmentation": {"counts": "abc", "size": [720, 1280]}}])},
         [], ("a crowd",)),
    Case("iscrowd null", "coco", {"a.json": coco([{"iscrowd": None}])}, [AT]),
    Case("occluded, as CVAT writes it", "coco", {"a.json": coco([{"attributes": {"occluded": True}}])},
         [(10_000, P, 639.5, 179.5)]),
    Case("a keypoint not labelled", "coco", {"a.json": coco([{"keypoints": [0, 0, 0]}])}, [AT]),
    Case("an odd visibility", "coco", {"a.json": coco([{"keypoints": [640, 180, 7]}])}, [], ("unknown visibility",)),
    Case("a keypoint in shares", "coco", {"a.json": coco([{"keypoints": [0.5, 0.25, 2]}])}, [],
         ("the keypoint lies far from its box",)),
    Case("keypoints in shares without boxes", "coco", {"a.json": coco([{"keypoints": [0.53, 0.25, 2], "bbox": None}])},
         [], ("shares of the picture",)),
    Case("a person's keypoints", "coco", {"a.json": coco([{"keypoints": [600, 100, 2] * 17}])}, [AT]),
    Case("a mask alone", "coco", {"a.json": coco([{"bbox": [], "segmentation": [[1, 1, 9, 1, 9, 9]]}])}, [],
         ("neither a keypoint nor a box",)),
    Case("names as Label Studio has them", "coco", {"result.json": coco(images=[{"id": 1,
         "file_name": "..\\\\..\\\\label-studio/data/media/upload/3/1a2b3c4d-frame_000001.png"}])}, [AT]),
    Case("two files with the same pictures", "coco", {"instances_default.json": coco(),
         "person_keypoints_default.json": coco([{"bbox": [10, 10, 20, 20]}])}, [],
         ("the same pictures are in several",)),
    Case("two files of other pictures", "coco", {"train/_annotations.coco.json": coco(), "valid/_annotations.coco.json":
         coco(images=[{"id": 1, "file_name": "frame_2.png"}])}, [AT, (20_000, V, 639.5, 179.5)]),
    Case("tasks of Label Studio", "coco", {"a.json": '[{"id": 1, "data": {"image": "x.png"}, "annotations": []}]'}, [],
         ("not a COCO file",)),
    Case("UTF-16", "coco", {"a.json": coco().encode("utf-16")}, [AT]),
    Case("resource forks", "coco", {"a.json": coco(), "._a.json": b"\0\5\x16\7"}, [AT]),
    Case("another size", "coco", {"a.json": coco(images=[{"id": 1, "file_name": "f_1.png", "width": 640,
         "height": 360}])}, [], ("another size than the sensor", "640x360")),
    Case("another size, scaled", "coco", {"a.json": coco([{"bbox": [315, 85, 10, 10], "area": 100}], images=[{"id": 1,
         "file_name": "f_1.png", "width": 640, "height": 360}])}, [AT], ("scaled to the sensor",),
         flags=("--scale-pictures",)),
    Case("another shape, scaled, is told", "coco", {"a.json": coco([{"bbox": [315, 155, 10, 10], "area": 100}], images=[
         {"id": 1, "file_name": "f_1.png", "width": 640, "height": 640}])}, [(10_000, V, 639.5, 179.5)],
         ("taken for stretched",), flags=("--scale-pictures",)),
    Case("upright pictures", "coco", {"a.json": coco(images=[{"id": 1, "file_name": "f_1.png", "width": 720,
         "height": 1280}])}, [], ("another size",), flags=("--scale-pictures",)),
    Case("sizes that differ", "coco", {"a.json": coco([{"image_id": 2}], images=[{"id": 1, "file_name": "f_1.png",
         "width": 640, "height": 360}, {"id": 2, "file_name": "f_2.png", "width": 1280, "height": 720}])},
         [(20_000, V, 639.5, 179.5)], ("another size",), flags=("--scale-pictures",)),
    Case("a size here, none there", "coco", {"a.json": coco([{"image_id": 2}], images=[{"id": 1, "file_name": "f_1.png",
         "width": 640, "height": 360}, {"id": 2, "file_name": "f_2.png"}])}, [], ("without a size",),
         flags=("--scale-pictures",)),
]  # fmt: skip

VOC = [
    Case("LabelImg", "voc", {"frame_000001.xml": voc((630, 170, 650, 190))}, [(10_000, V, 640.0, 180.0)]),
    Case("decimals", "voc", {"frame_000001.xml": voc((630.5, 170.5, 649.5, 189.5))}, [AT]),
    Case("flags", "voc", {f"frame_00000{k}.xml": voc((630, 170, 650, 190), f"frame_00000{k}.png", extra=flag)
         for k, flag in enumerate(("<difficult>1</difficult>", "<occluded>1</occluded>", "<truncated>1</truncated>",
                                   "<difficult>0</difficult><truncated>0</truncated>"))},
         [(0, P, 640.0, 180.0), (10_000, P, 640.0, 180.0), (20_000, P, 640.0, 180.0), (30_000, V, 640.0, 180.0)]),
    Case("impossible boxes", "voc", {f"frame_00000{k}.xml": voc(edges, f"frame_00000{k}.png") for k, edges in enumerate(
         ((650, 170, 630, 190), (630, 190, 650, 170), (630, 170, 630, 190), ("nan", 170, 650, 190),
          (1300, 170, 1320, 190), (-40, 170, -20, 190), (0.49, 0.23, 0.51, 0.26), ("", 170, 650, 190)))}, [],
         ("the box is empty", "not a finite number", "the centre is outside", "smaller than a pixel")),
    Case("no objects: somebody saved it", "voc", {"frame_000001.xml": voc(())}, [(10_000, N, None, None)]),
    Case("no objects, of CVAT", "voc", {"frame_000001.xml": voc(()).replace("<size>", "<source><database>Unknown"
         "</database><annotation>Unknown</annotation><image>Unknown</image></source><size>")}, [],
         ("nobody may have looked at it",)),
    Case("names that contradict", "voc", {"frame_000002.xml": voc((630, 170, 650, 190))}, [],
         ("are of two pictures",)),
    Case("no size known", "voc", {"frame_000001.xml": voc((630, 170, 650, 190), size="0,0")},
         [(10_000, V, 640.0, 180.0)]),
    Case("another size", "voc", {"frame_000001.xml": voc((630, 170, 650, 190), size="2560,1440")}, [], ("2560x1440",)),
    Case("another size, scaled", "voc", {"frame_000001.xml": voc((1270, 350, 1290, 370), size="2560,1440")},
         [(10_000, V, 639.75, 179.75)], ("scaled to the sensor",), flags=("--scale-pictures",)),
    Case("another class", "voc", {"frame_000001.xml": voc((630, 170, 650, 190), label="racket")}, [],
         ("class 'racket' is not 'ball'",)),
    Case("two balls", "voc", {"frame_000001.xml": voc((630, 170, 650, 190)).replace("</annotation>",
         "<object><name>ball"
         "</name><bndbox><xmin>1</xmin><ymin>1</ymin><xmax>9</xmax><ymax>9</ymax></bndbox></object></annotation>")},
         [(10_000, V, 640.0, 180.0)], ("a second label at 10000 us",)),
    Case("the ending in capitals", "voc", {"frame_000001.xml": voc((630, 170, 650, 190), "FRAME_000001.JPG")},
         [(10_000, V, 640.0, 180.0)]),
    Case("many centres outside, no size", "voc", {f"frame_{k:06d}.xml": voc((1000 + 100 * k, 170, 1020 + 100 * k, 190),
         f"frame_{k:06d}.png", "0,0") for k in range(1, 11)}, [], ("most centres are outside",)),
]  # fmt: skip

CVAT = [
    Case("a box", "cvat", {"annotations.xml": cvat(CVAT_BALL)}, [AT]),
    Case("occluded", "cvat", {"annotations.xml": cvat(CVAT_BALL.replace('occluded="0"', 'occluded="1"'))},
         [(10_000, P, 639.5, 179.5)]),
    Case("a polygon", "cvat", {"annotations.xml": cvat(
         '<polygon label="ball" points="630,180;640,170;650,180;640,190"/>')},
         [AT]),
    Case("nothing in a picture", "cvat", {"annotations.xml": cvat("")}, [], ("nobody may have looked at it",)),
    Case("nothing, looked at", "cvat", {"annotations.xml": cvat("")}, [(10_000, N, None, None)],
         flags=("--empty-pictures", "no-ball")),
    Case("a rejected box is not no ball", "cvat", {"annotations.xml": cvat(
         CVAT_BALL.replace('xbr="650"', 'xbr="600"'))},
         [], ("the box is empty",), flags=("--empty-pictures", "no-ball")),
    Case("the index and the name contradict", "cvat", {"annotations.xml": cvat(CVAT_BALL, number=0)}, [],
         ("is not the number in its name",)),
    Case("the index alone", "cvat", {"annotations.xml": cvat(CVAT_BALL, name="a.png")}, [AT]),
    Case("another size", "cvat", {"annotations.xml": cvat(CVAT_BALL, size='width="640" height="480"')}, [],
         ("640x480",)),
    Case("the same picture in two folders", "cvat", {"annotations.xml": cvat(CVAT_BALL, "left/frame_1.png", 1).replace(
         "</annotations>", f'<image id="2" name="right/frame_1.png">{CVAT_BALL}</image></annotations>')}, [],
         ("several pictures have this name",)),
    Case("a video", "cvat", {"annotations.xml": video(box(1, 640) + box(2, 650, keyframe=0) + box(3, 660)
         + box(4, 660, outside=1))}, [AT, (20_000, V, 649.5, 179.5), (30_000, V, 659.5, 179.5)],
         ("1 shape of an object that is outside",)),
    Case("outside, in a picture", "cvat", {"annotations.xml": cvat(CVAT_BALL.replace('occluded="0"', 'outside="1"'))},
         [], ("outside of the picture, or hidden",), flags=("--empty-pictures", "no-ball")),
    Case("a video, occluded", "cvat", {"annotations.xml": video(box(1, 640, occluded=1))}, [(10_000, P, 639.5, 179.5)]),
    Case("a keyframe that is held", "cvat", {"annotations.xml": video(box(1, 640) + box(2, 640, keyframe=0)
         + box(3, 640, keyframe=0) + box(4, 700))}, [AT, (40_000, V, 699.5, 179.5)], ("only repeats the keyframe",)),
    Case("a track that never ends", "cvat", {"annotations.xml": video(box(1, 640) + "".join(box(k, 640, keyframe=0)
         for k in range(2, 90)))}, [AT], ("only repeats the keyframe",)),
    Case("a track of a person", "cvat", {"annotations.xml": video(box(1, 640), label="person")}, [],
         ("a track of label 'person'",)),
    Case("a part of a video", "cvat", {"annotations.xml": video(box(50, 640),
         "<meta><task><start_frame>50</start_frame>"
         "<frame_filter>step=5</frame_filter></task></meta>")}, [(500_000, V, 639.5, 179.5)],
         ("begins at frame 50", "step=5")),
    Case("a video of another size", "cvat", {"annotations.xml": video(box(1, 640), "<meta><task><original_size>"
         "<width>1920</width><height>1080</height></original_size></task></meta>")}, [], ("1920x1080",)),
    Case("two videos", "cvat", {"a.xml": video(box(1, 640)), "b.xml": video(box(2, 640))}, [],
         ("each with its own count",)),
]  # fmt: skip


def studio(*regions: dict, image: str = "/data/upload/1/1a2b3c4d-frame_000001.png", **task: object) -> str:
    inside = [{"type": "labels", "original_width": 1280, "original_height": 720, **one} for one in regions]
    whole = {"id": 5, "data": {"image": image}, "annotations": [{"id": 1, "result": inside}], "predictions": []}
    return json.dumps([{**whole, **task}], indent=1)


def rectangle(
    x: float = 49.21875, y: float = 23.611111, w: float = 1.5625, h: float = 2.777778, **more: object
) -> dict:
    value = {"x": x, "y": y, "width": w, "height": h, "rotation": 0, "rectanglelabels": ["ball"], **more}
    return {"value": value}


STUDIO = [
    Case("a rectangle", "label-studio", {"a.json": studio(rectangle())}, [AT]),
    Case(
        "JSON-MIN",
        "label-studio",
        {
            "a.json": json.dumps(
                [
                    {
                        "image": "frame_1.png",
                        "id": 3,
                        "annotation_id": 4,
                        "label": [{**rectangle()["value"], "original_width": 1280, "original_height": 720}],
                    }
                ]
            )
        },
        [AT],
    ),
    Case(
        "a local file",
        "label-studio",
        {"a.json": studio(rectangle(), image="/data/local-files/?d=a%2Fframe_1.png")},
        [AT],
    ),
    Case(
        "an ellipse and a keypoint",
        "label-studio",
        {
            "a.json": studio(
                {"value": {"x": 50, "y": 25, "radiusX": 0.78, "radiusY": 1.39, "ellipselabels": ["Ball"]}}
            ),
            "b.json": studio({"value": {"x": 50, "y": 25, "width": 0.2, "keypointlabels": ["ball"]}}, image="f_2.png"),
        },
        [AT, (20_000, V, 639.5, 179.5)],
    ),
    Case(
        "a polygon",
        "label-studio",
        {"a.json": studio({"value": {"points": [[49, 24], [51, 24], [51, 26], [49, 26]], "polygonlabels": ["ball"]}})},
        [AT],
    ),
    Case(
        "a rectangle turned round its corner",
        "label-studio",
        {"a.json": studio(rectangle(50.78125, 23.611111, 2.777778 * 720 / 1280, 1.5625 * 1280 / 720, rotation=90))},
        [AT],
    ),
    Case(
        "another label",
        "label-studio",
        {"a.json": studio(rectangle(rectanglelabels=["person"]))},
        [],
        ("is not 'ball'",),
    ),
    Case("submitted without a region", "label-studio", {"a.json": studio()}, [(10_000, N, None, None)]),
    Case("nobody looked", "label-studio", {"a.json": studio(annotations=[])}, [], ("nobody may have looked at it",)),
    Case(
        "skipped",
        "label-studio",
        {"a.json": studio(annotations=[{"id": 1, "was_cancelled": True, "result": []}])},
        [],
        ("nobody may have looked at it",),
    ),
    Case(
        "two persons",
        "label-studio",
        {"a.json": studio(annotations=[{"id": 1, "result": []}, {"id": 2, "result": []}])},
        [],
        ("whose counts?",),
    ),
    Case(
        "predictions are no labels",
        "label-studio",
        {"a.json": studio(annotations=[], predictions=[{"result": [rectangle()]}])},
        [],
        ("nobody may have looked at it",),
    ),
    Case("no width", "label-studio", {"a.json": studio(rectangle(w=0))}, [], ("the box is empty",)),
    Case("no numbers", "label-studio", {"a.json": studio(rectangle(x=None))}, [], ("not a finite number",)),
    Case("outside", "label-studio", {"a.json": studio(rectangle(x=120))}, [], ("the centre is outside",)),
    Case(
        "a mask",
        "label-studio",
        {"a.json": studio({"type": "brushlabels", "value": {"format": "rle"}})},
        [],
        ("not a region that can be a ball",),
    ),
    Case(
        "another size",
        "label-studio",
        {"a.json": studio({**rectangle(), "original_width": 1920, "original_height": 1080})},
        [],
        ("1920x1080",),
    ),
    Case(
        "another size, scaled",
        "label-studio",
        {"a.json": studio({**rectangle(), "original_width": 1920, "original_height": 1080})},
        [AT],
        ("scaled to the sensor",),
        flags=("--scale-pictures",),
    ),
    Case("COCO", "label-studio", {"a.json": coco()}, [], ("which picture is it?",)),
]

TRACKNET = [
    Case("codes 0 to 3", "tracknet", {"a_ball.csv": LETTERS + "0,0,0,0\n1,1,640,180\n2,2,641,180\n3,3,642,180\n"},
         [(0, N, None, None), (10_000, V, 640.0, 180.0), (20_000, P, 641.0, 180.0), (30_000, O, 642.0, 180.0)]),
    Case("an unknown code", "tracknet", {"a.csv": LETTERS + "0,1,5,5\n1,4,640,180\n2,-1,3,3\n"}, [(0, V, 5.0, 5.0)],
         ("unknown visibility",)),
    Case("small letters, spaces, more columns", "tracknet", {"a.csv":
         "frame, visibility, x, y, Time\n1,1,640,180,00:01\n"},
         [(10_000, V, 640.0, 180.0)]),
    Case("semicolons and decimal commas", "tracknet", {"a.csv": "Frame;Visibility;X;Y\r\n1;1;640,5;180,25\r\n"},
         [(10_000, V, 640.5, 180.25)]),
    Case("tabs and a byte-order mark", "tracknet", {"a.csv": "\ufeffFrame\tVisibility\tX\tY\n1\t1\t640\t180\n"},
         [(10_000, V, 640.0, 180.0)]),
    Case("decimals of pandas", "tracknet", {"a.csv": LETTERS + "1.0,1.0,640.0,180.0\n2.0,0.0,,\n"},
         [(10_000, V, 640.0, 180.0), (20_000, N, None, None)]),
    Case("a position that is none", "tracknet", {"a.csv": LETTERS + "1,1,-1,-1\n2,1,nan,nan\n3,0,640,180\n4,3,,\n"},
         [(40_000, O, None, None)], ("the centre is outside", "not a finite number", "there is no ball")),
    Case("shares", "tracknet", {"a.csv": LETTERS + "1,1,0.5,0.25\n2,1,0.6,0.35\n"}, [], ("shares of the picture",)),
    Case("two clips in a folder", "tracknet", {"rally1_ball.csv": LETTERS + "0,1,9,9\n1,1,640,180\n", "rally2_ball.csv":
         LETTERS + "0,1,20,20\n1,1,30,30\n2,1,40,40\n"}, [], ("the same pictures are in several files",)),
    Case("a frame twice", "tracknet", {"a.csv": LETTERS + "1,1,640,180\n1,1,5,5\n"}, [(10_000, V, 640.0, 180.0)],
         ("a second label at 10000 us",)),
    Case("counted from 1", "tracknet", {"a.csv": LETTERS + "".join(f"{k},1,640,180\n" for k in range(1, 101))}, [],
         ("numbered from 1",)),
    Case("after the recording", "tracknet", {"a.csv": LETTERS + "1,1,640,180\n2,1,640,180\n"},
         [(10_000, V, 640.0, 180.0)], ("the time lies after the recording",),
         times="t_us\n0\n10000\n1700000000000000\n"),
]  # fmt: skip

TABLES = [
    Case("ours, in another order", "csv", {"a.csv": "state,y_px,x_px,t_us\nvisible,180,640,10000\n"},
         [(10_000, V, 640.0, 180.0)]),
    Case("ours, semicolons", "csv", {"a.csv": "\ufefft_us;state;x_px;y_px\r\n10000;visible;640,5;180\r\n"},
         [(10_000, V, 640.5, 180.0)]),
    Case("ours, outside and afterwards", "csv", {"a.csv": "t_us,state,x_px,y_px\n1,visible,5000,180\n2,no_ball,,\n"
         "99000000,visible,5,5\n3,visible,,\n4,seen,1,1\n"}, [(2, N, None, None)],
         ("the centre is outside", "after the recording", "without a position", "'seen'")),
    Case("ours, milliseconds", "csv", {"a.csv": "t_ms,state,x_px,y_px\n10,visible,640,180\n"}, [],
         ("not a label table",)),
    Case("rows that another tool calls none", "csv", {"a.csv": "t_us,x,y,visible\n10000,640,180,1\n20000,640,180,0\n"},
         [(10_000, V, 640.0, 180.0)], ("1 row left out: a column says that there is no ball",)),
    Case("the same in words", "csv", {"a.csv": "t_us,x,y,detected\n10000,640,180,True\n20000,640,180,False\n"},
         [(10_000, V, 640.0, 180.0)], ("left out",)),
    Case("one track", "csv", {"a.csv": "t_us,x,y,track_id\n10000,640,180,7\n20000,641,180,7\n"},
         [(10_000, V, 640.0, 180.0), (20_000, V, 641.0, 180.0)]),
    Case("two tracks", "csv", {"a.csv": "t_us,x,y,track_id\n10000,640,180,1\n20000,9,9,2\n"}, [],
         ("several tracks in one table: expected one value, got track_id = 1, 2",)),
    Case("corners of boxes", "csv", {"a.csv": "t_us,x,y,box_width,box_height\n10000,640,180,12,12\n"}, [],
         ("beside the sides of a box",)),
    Case("two cameras", "csv", {"a.csv": "t_us,x,y,camera\n10000,640,180,left\n20000,9,9,right\n"}, [],
         ("got camera = left, right",)),
    Case("times in ms", "tracknet", {"a.csv": LETTERS + "1,1,640,180\n"}, [(16_667, V, 640.0, 180.0)],
         times="t_ms\n0\n16.667\n"),
    Case("times in s", "tracknet", {"a.csv": LETTERS + "1,1,640,180\n"}, [(16_667, V, 640.0, 180.0)],
         times="t_s\n0\n0.016667\n"),
    Case("times by number", "tracknet", {"a.csv": LETTERS + "7,1,640,180\n1,1,5,5\n"}, [(20_000, V, 640.0, 180.0)],
         ("no such frame",), times="frame;t_us\n5;10000\n7;20000\n"),
    Case("times by name", "yolo", {"classes.txt": "ball\n", "a b.txt": BALL, "c.txt": BALL},
         [(70_000, V, 639.5, 179.5)],
         ("not in --frame-times",), times="file_name,t_us\nimages/a b.png,70000\n"),
    Case("times that go back", "tracknet", {"a.csv": LETTERS + "1,1,5,5\n"}, [], ("go back",), times="t_us\n9\n7\n"),
    Case("microseconds with a fraction", "tracknet", {"a.csv": LETTERS + "1,1,5,5\n"}, [], ("of another unit",),
         times="t_us\n0\n0.0167\n"),
]  # fmt: skip


@pytest.mark.parametrize(
    "case", YOLO + COCO + VOC + CVAT + STUDIO + TRACKNET + TABLES, ids=lambda case: f"{case.kind}: {case.name}"
)
def test_what_another_tool_wrote_is_read_right_or_refused_with_the_reason(case: Case, tmp_path: Path) -> None:
    times = {} if case.times is None else {"times": case.times}
    made = import_files(tmp_path, case.kind, case.files, *case.flags, cameras=case.cameras, **times)
    assert len(made.rows) == len(case.rows), made
    for found, (t_us, state, x, y) in zip(made.rows, case.rows, strict=True):
        assert found[:2] == (t_us, state)
        assert found[2] == (None if x is None else pytest.approx(x, abs=0.02)), made
        assert found[3] == (None if y is None else pytest.approx(y, abs=0.02)), made
    assert made.code == (0 if case.rows else 2)
    if case.rows:
        for words in case.says:
            assert words in made.said, made
    else:
        assert [words for words in case.says if words in made.error], made.error


def test_what_cvat_interpolated_is_not_by_hand(tmp_path: Path) -> None:
    made = import_files(tmp_path, "cvat", {"a.xml": video(box(1, 640) + box(2, 650, keyframe=0) + box(3, 660))})
    assert made.sources == ["imported", "interpolated", "imported"]
    assert "outside" not in made.said


def test_the_table_counts_every_reason_with_three_examples(tmp_path: Path) -> None:
    lines = "".join(f"{k},1,5000,180\n" for k in range(10)) + "".join(f"{k},1,{k},180\n" for k in range(10, 40))
    made = import_files(tmp_path, "tracknet", {"a.csv": LETTERS + lines + "41,9,1,1\n"})
    assert made.reasons == {"the centre is outside the picture": 10, "unknown visibility": 1}
    assert len(made.rejected) == 11 and len(made.rows) == 30
