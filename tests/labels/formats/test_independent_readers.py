"""What we export, read by the programs that it is meant for, and by readers written from the formats' definitions."""

from __future__ import annotations

import csv
import dataclasses
import warnings
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from libs.pascal_voc_io import PascalVocReader, PascalVocWriter
from libs.yolo_io import YoloReader
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from labels.formats import FORMATS, ExportOptions, LabelSet
from labels.formats.exchange import picture_name
from labels.model import Label, LabelState


def seen(labels: LabelSet) -> list[Label]:
    return [label for label in labels.labels if label.state.seen]


def truth(labels: LabelSet) -> np.ndarray:
    return np.array([(label.x_px, label.y_px, label.r_px) for label in seen(labels)])


def test_labelimg_reads_our_boxes_within_a_rounding(balls: LabelSet, tmp_path: Path) -> None:
    FORMATS["voc"].write(balls, tmp_path, ExportOptions())
    centres = []
    for label in seen(balls):
        shapes = PascalVocReader(str(tmp_path / f"{picture_name(balls.camera, label.t_us)}.xml")).get_shapes()
        assert len(shapes) == 1  # it swallows every error and then has none
        assert shapes[0][0] == "ball"
        centres.append(np.mean(shapes[0][1], axis=0) - 0.5)
    error = np.array(centres) - truth(balls)[:, :2]
    assert np.hypot(*error.T).max() <= 0.71
    no_ball = next(label for label in balls.labels if label.state is LabelState.NO_BALL)
    assert PascalVocReader(str(tmp_path / f"{picture_name(balls.camera, no_ball.t_us)}.xml")).get_shapes() == []


def test_our_rounding_has_no_bias_when_labelimg_reads_it(balls: LabelSet, tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    places = rng.uniform((30, 30, 2), (1250, 690, 12), (1000, 3))
    labels = tuple(
        Label(t_us=t, state=LabelState.VISIBLE, x_px=float(x), y_px=float(y), r_px=float(r))
        for t, (x, y, r) in enumerate(places)
    )
    files = FORMATS["voc"].write(dataclasses.replace(balls, labels=labels), tmp_path, ExportOptions()).files
    read = [np.mean(PascalVocReader(str(file)).get_shapes()[0][1], axis=0) - 0.5 for file in files]
    assert np.abs((np.array(read) - places[:, :2]).mean(axis=0)).max() <= 0.02


def test_our_xml_is_byte_for_byte_what_labelimg_writes(tmp_path: Path, odd: LabelSet) -> None:
    labels = tuple(
        Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=100.5, r_px=r)
        for t_us, (x, r) in enumerate(((200.5, 8.0), (3.5, 4.0), (1275.5, 4.0)))
    )
    ours = dataclasses.replace(odd, labels=labels)
    FORMATS["voc"].write(ours, tmp_path / "ours", ExportOptions(own_extras=False))
    for label in labels:
        name = picture_name("left", label.t_us)
        writer = PascalVocWriter("ours", f"{name}.png", (720, 1280, 1), local_img_path=f"{name}.png")
        assert label.x_px is not None and label.y_px is not None and label.r_px is not None
        x, y, r = label.x_px + 0.5, label.y_px + 0.5, label.r_px
        writer.add_bnd_box(max(1, int(x - r)), int(y - r), int(x + r), int(y + r), "ball", 0)
        theirs = tmp_path / f"{name}.xml"
        writer.save(str(theirs))
        assert (tmp_path / "ours" / f"{name}.xml").read_bytes() == theirs.read_bytes()


def test_boxes_drawn_in_labelimg_are_read_without_bias(tmp_path: Path, balls: LabelSet) -> None:
    for label in seen(balls):
        assert label.x_px is not None and label.y_px is not None and label.r_px is not None
        x, y, r = label.x_px + 0.5, label.y_px + 0.5, label.r_px
        writer = PascalVocWriter("d", "x.png", (720, 1280, 1))
        writer.add_bnd_box(*(int(edge) for edge in (x - r, y - r, x + r, y + r)), "ball", 0)
        writer.save(str(tmp_path / f"p{label.t_us}.xml"))
        file = tmp_path / f"p{label.t_us}.xml"
        file.write_text(file.read_text().replace("x.png", f"frame_{len(list(tmp_path.iterdir())) - 1}.png"))
    times = np.array([label.t_us for label in seen(balls)])
    from labels.formats import ImportContext

    imported = FORMATS["voc"].read(tmp_path, ImportContext(balls.sensor, times))
    assert imported.rejections == ()
    back = np.array([(label.x_px, label.y_px) for label in imported.labels])
    error = back - truth(balls)[:, :2]
    assert np.hypot(*error.T).max() <= 0.71
    assert np.abs(error.mean(axis=0)).max() < 0.07


def test_labelimg_reads_our_yolo_files(balls: LabelSet, tmp_path: Path) -> None:
    FORMATS["yolo"].write(balls, tmp_path, ExportOptions())
    picture = SimpleNamespace(height=lambda: 720, width=lambda: 1280, isGrayscale=lambda: True)
    for label, (x, y, _) in zip(seen(balls), truth(balls), strict=True):
        file = tmp_path / f"{picture_name(balls.camera, label.t_us)}.txt"
        shapes = YoloReader(str(file), picture).get_shapes()
        assert len(shapes) == 1
        assert shapes[0][0] == "ball"
        assert np.hypot(*(np.mean(shapes[0][1], axis=0) - 0.5 - (x, y))) <= 0.71  # it rounds to whole pixels


def test_supervision_reads_our_yolo_and_voc_files(balls: LabelSet, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import supervision as sv
    few = dataclasses.replace(balls, camera="left", labels=balls.labels[2:7])
    images = tmp_path / "images"
    images.mkdir()
    for label in few.labels:
        cv2.imwrite(str(images / f"{picture_name('left', label.t_us)}.png"), np.zeros((720, 1280), np.uint8))
    FORMATS["yolo"].write(few, tmp_path / "yolo", ExportOptions())
    yolo = sv.DetectionDataset.from_yolo(str(images), str(tmp_path / "yolo"), str(tmp_path / "yolo" / "data.yaml"))
    assert yolo.classes == ["ball"]
    boxes = [yolo.annotations[path].xyxy[0] for path in sorted(yolo.annotations)]
    centres = [(box[:2] + box[2:]) / 2 - 0.5 for box in boxes]
    np.testing.assert_allclose(centres, truth(few)[:, :2], atol=0.01)
    FORMATS["voc"].write(few, tmp_path / "voc", ExportOptions(whole_pixels=False))
    voc = sv.DetectionDataset.from_pascal_voc(str(images), str(tmp_path / "voc"))
    boxes = [voc.annotations[path].xyxy[0] for path in sorted(voc.annotations)]
    centres = [
        (box[:2] + box[2:]) / 2 for box in boxes
    ]  # it takes 1 off the smaller corner, half a pixel off the centre
    np.testing.assert_allclose(centres, truth(few)[:, :2], atol=0.01)


@pytest.mark.parametrize("what", ["keypoints", "bbox"])
def test_pycocotools_scores_our_own_labels_as_perfect(balls: LabelSet, tmp_path: Path, what: str) -> None:
    file = FORMATS["coco"].write(balls, tmp_path, ExportOptions()).files[0]
    coco = COCO(str(file))
    assert len(coco.getImgIds()) == len(balls.labels)
    entries = coco.loadAnns(coco.getAnnIds())
    np.testing.assert_allclose([entry["keypoints"][:2] for entry in entries], truth(balls)[:, :2] + 0.5)
    found = coco.loadRes(
        [{**{key: entry[key] for key in ("image_id", "category_id", what)}, "score": 0.9} for entry in entries]
    )
    evaluation = COCOeval(coco, found, what)
    if what == "keypoints":
        evaluation.params.kpt_oks_sigmas = np.array([0.1])
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    assert evaluation.stats[0] == 1.0


def test_a_cvat_reader_written_from_its_definition_agrees(balls: LabelSet, tmp_path: Path) -> None:
    """Of datumaro, whose reader this stands for, no version accepts the OpenCV that the project needs."""
    file = FORMATS["cvat"].write(balls, tmp_path, ExportOptions()).files[0]
    root = ElementTree.parse(file).getroot()
    assert root.tag == "annotations"
    assert root.findtext("version") == "1.1"
    declared = {item.findtext("name") for item in root.iterfind("meta/task/labels/label")}
    images = root.findall("image")
    assert [int(image.attrib["id"]) for image in images] == list(range(len(balls.labels)))
    assert root.findtext("meta/task/size") == str(len(images))
    centres = []
    for image in images:
        assert (image.attrib["width"], image.attrib["height"]) == ("1280", "720")
        for shape in image:
            assert shape.attrib["label"] in declared
            if shape.tag == "points":
                assert shape.attrib["occluded"] == "0"
                centres.append([float(text) for text in shape.attrib["points"].split(",")])
    np.testing.assert_allclose(centres, truth(balls)[:, :2] + 0.5, atol=0.0051)


def test_a_tracknet_reader_written_from_its_definition_agrees(balls: LabelSet, tmp_path: Path) -> None:
    file = FORMATS["tracknet"].write(balls, tmp_path, ExportOptions()).files[0]
    with file.open(newline="") as text:
        rows = list(csv.DictReader(text))
    assert [int(row["Frame"]) for row in rows] == list(range(len(balls.labels)))
    for row, label in zip(rows, balls.labels, strict=True):
        assert int(row["Visibility"]) == int(label.state.seen)
        x, y = (label.x_px, label.y_px) if label.state.seen else (0, 0)
        assert x is not None and y is not None
        assert abs(int(row["X"]) - x) <= 0.5 and abs(int(row["Y"]) - y) <= 0.5


def test_a_yolo_pose_reader_written_from_its_definition_agrees(balls: LabelSet, tmp_path: Path) -> None:
    """The checks that Ultralytics makes of a file: fields, shares of the picture, visibility, one line a ball."""
    FORMATS["yolo-pose"].write(balls, tmp_path, ExportOptions())
    for label in balls.labels:
        lines = (tmp_path / f"{picture_name(balls.camera, label.t_us)}.txt").read_text().splitlines()
        assert len(lines) == int(label.state.seen)
        for line in lines:
            numbers = np.array(line.split(" "), float)
            assert numbers.shape == (8,) and numbers[0] == 0 and numbers[7] == 2
            assert (numbers[1:7] >= 0).all() and (numbers[1:7] <= 1).all()
            np.testing.assert_allclose(numbers[5:7] * (1280, 720) - 0.5, (label.x_px, label.y_px), atol=0.002)
