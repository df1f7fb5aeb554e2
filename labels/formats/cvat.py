"""CVAT XML 1.1: written for images, points with two decimals counted from the picture's corner, states as tags.

Read are images and the tracks of videos.
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from core.errors import LabelError
from core.text import counted
from labels.formats.boxes import circle_of_polygon
from labels.formats.documents import XmlNode, parse_xml
from labels.formats.exchange import (
    CLASS_NAME,
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    count_losses,
    finite,
    picture_name,
    whole_number,
    write_text,
)
from labels.formats.labelled_pictures import (
    DrawnShape,
    Picture,
    Place,
    StatedSize,
    add_pictures,
    parse_files,
    scaling_of,
    stated_size,
    unrepeated,
)
from labels.formats.picture_names import own_camera, stem_of
from labels.formats.picture_times import check_numbers
from labels.model import Label, LabelState, PositionSource

FILE = "annotations.xml"
STATE, RADIUS = "state", "r_px"
TRUE: Final = ("1", "true", "True")
PLACE: Final = ("points", "xtl", "ytl", "xbr", "ybr", "cx", "cy", "rx", "ry")
"""Attributes that say where a shape is."""
_TAGS = {state.value: state for state in LabelState if not state.seen}


def write_cvat(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`annotations.xml` in the folder.

    Raises:
        LabelError: if there is one of another camera.
    """
    _refuse_other_camera(folder / FILE, labels.camera)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
    lines += _meta(labels)
    for number, label in enumerate(labels.labels):
        name = quoteattr(f"{picture_name(labels.camera, label.t_us)}.png")
        size = f'width="{labels.sensor.width_px}" height="{labels.sensor.height_px}"'
        lines.append(f'  <image id="{number}" name={name} {size}>')
        lines += _points(label) if label.x_px is not None else [f'    <tag label="{label.state}" source="manual"/>']
        lines.append("  </image>")
    lines += ["</annotations>", ""]
    losses = ["provenance and covariance"] * bool(labels.labels)
    return Exported((write_text(folder / FILE, "\n".join(lines)),), count_losses(losses))


def _refuse_other_camera(file: Path, camera: str) -> None:
    names = re.findall(r'<image [^>]*\bname="([^"]*)"', file.read_text("utf-8", "replace")) if file.is_file() else []
    others = {own_camera(stem_of(unescape(name))) for name in names} - {None, camera}
    if others:
        got, remedy = f"labels of {', '.join(sorted(map(str, others)))}", "give each camera a folder of its own"
        raise LabelError("the file holds another camera", got=got, where=file, remedy=remedy)


def _meta(labels: LabelSet) -> list[str]:
    attribute = "          <attribute><name>{}</name><mutable>True</mutable><input_type>{}</input_type></attribute>"
    return [
        "  <meta>",
        "    <task>",
        f"      <size>{len(labels.labels)}</size>",
        "      <mode>annotation</mode>",
        "      <labels>",
        f"        <label><name>{CLASS_NAME}</name><type>points</type><attributes>",
        attribute.format(STATE, "select"),
        attribute.format(RADIUS, "text"),
        "        </attributes></label>",
        *(f"        <label><name>{tag}</name><type>tag</type><attributes></attributes></label>" for tag in _TAGS),
        "      </labels>",
        "    </task>",
        "  </meta>",
    ]


def _points(label: Label) -> list[str]:
    assert label.x_px is not None and label.y_px is not None, "points need a position"
    occluded = int(label.state is not LabelState.VISIBLE)
    place = f"{label.x_px + HALF_PIXEL:.2f},{label.y_px + HALF_PIXEL:.2f}"
    radius = [] if label.r_px is None else [f'      <attribute name="{RADIUS}">{label.r_px!r}</attribute>']
    return [
        f'    <points label="{CLASS_NAME}" source="manual" occluded="{occluded}" points="{place}" z_order="0">',
        f'      <attribute name="{STATE}">{label.state}</attribute>',
        *radius,
        "    </points>",
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Video:
    """One file of tracks."""

    file: Path
    root: XmlNode
    tracks: list[XmlNode]


def read_cvat(path: Path, context: ImportContext) -> Imported:
    """Every XML file of a folder, or one."""
    collector = Collector()
    videos: list[_Video] = []
    pictures = parse_files(path, ".xml", context, collector, partial(_pictures_in, videos=videos))
    pictures = unrepeated(pictures, collector)
    if len(videos) > 1 or (videos and pictures):
        # Frames of a video have no names, only counts: those of two files are not the same pictures.
        what = "several files, each with its own count of pictures: import one of them"
        for video in videos:
            collector.reject(video.file, 1, what)
        videos = []
    for video in videos:
        _read_tracks(video, context, collector)
    add_pictures(pictures, context, collector)
    return collector.done()


def _pictures_in(
    text: str, file: Path, context: ImportContext, collector: Collector, *, videos: list[_Video]
) -> list[Picture]:
    """The pictures of one file; a file of tracks is added to the videos."""
    root = parse_xml(text)
    if root.tag != "annotations":
        collector.reject(file, root.line, f"not a CVAT file; expected <annotations>, got <{root.tag}>")
        return []
    pictures = [_picture_of(item, file, context) for item in root.all("image")]
    tracks = list(root.all("track"))
    videos += [_Video(file, root, tracks)] if tracks and not pictures else []
    for track in tracks if pictures else ():
        collector.reject(file, track.line, "a track among images: export for images or for video, not both")
    for item in root.children:
        if item.tag not in ("version", "meta", "image", "track"):
            collector.reject(file, item.line, f"<{item.tag}> is not read")
    return pictures


def _picture_of(image: XmlNode, file: Path, context: ImportContext) -> Picture:
    def index() -> int | None:
        return whole_number(image.attributes["id"], "the image's id") if image.attributes.get("id") else None

    def whole(place: Place) -> Label | None:
        place.check_size()
        image.attribute("name")  # one without a name is refused, though others may tell its number
        t_us = place.t_us
        return None if image.children else context.unannotated(t_us)  # also frames nobody saw: cvat-ai/cvat#1251

    return Picture(
        file=file,
        line=image.line,
        names=(image.attributes.get("name", ""),),
        size=(image.attributes.get("width"), image.attributes.get("height")),
        index=index,
        whole=whole,
        shapes=[DrawnShape(shape.line, partial(_label_of, shape, context)) for shape in image.children],
    )


def _label_of(shape: XmlNode, context: ImportContext, place: Place) -> Label:
    name = shape.attribute("label")
    if shape.tag == "tag" and name in _TAGS:
        return context.make(place.t_us, _TAGS[name])
    if not context.is_ball(name):
        raise LabelError(f"label {name!r} is not {context.ball_class or CLASS_NAME!r}")
    return _label_of_shape(shape, place.t_us, place.factors, context)


def _label_of_shape(shape: XmlNode, t_us: int, factors: tuple[float, float], context: ImportContext) -> Label:
    """The ball that a shape is.

    Raises:
        LabelError: if it is none.
    """
    if shape.attributes.get("outside", "0") in TRUE:
        raise LabelError("the object is outside of the picture, or hidden: no label")
    attributes = {item.attribute("name"): item.text.strip() for item in shape.all("attribute")}
    state = LabelState.PARTLY_OCCLUDED if shape.attributes.get("occluded", "0") in TRUE else LabelState.VISIBLE
    state = LabelState(attributes[STATE]) if STATE in attributes else state
    across, down = factors
    radius = finite(attributes[RADIUS], RADIUS) * (across + down) / 2 if attributes.get(RADIUS) else None
    if shape.tag == "points":
        places = shape.attribute("points").split(";")
        if len(places) != 1 or places[0].count(",") != 1:
            raise LabelError("not one point", got=shape.attributes["points"][:80])
        x, y = (finite(text, "a coordinate") for text in places[0].split(","))
    elif shape.tag == "box":
        x0, y0, x1, y1 = (finite(shape.attribute(edge), edge) for edge in ("xtl", "ytl", "xbr", "ybr"))
        if x1 <= x0 or y1 <= y0:
            raise LabelError("the box is empty", got=(x0, y0, x1, y1))
        x, y, radius = (x0 + x1) / 2, (y0 + y1) / 2, ((x1 - x0) * across + (y1 - y0) * down) / 4
    elif shape.tag == "ellipse":
        x, y = (finite(shape.attribute(edge), edge) for edge in ("cx", "cy"))
        rx, ry = (finite(shape.attribute(edge), edge) for edge in ("rx", "ry"))
        if rx <= 0 or ry <= 0:
            raise LabelError("the ellipse is empty", got=(rx, ry))
        radius = (rx * across + ry * down) / 2
    elif shape.tag == "polygon" and shape.attribute("points").count(";") >= 2:
        pairs = [place.split(",") for place in shape.attribute("points").split(";")]
        corners = [[finite(text, "a coordinate") for text in pair] for pair in pairs if len(pair) == 2]
        if len(corners) != len(pairs):
            raise LabelError("not a polygon", got=shape.attributes["points"][:80])
        x, y, radius = circle_of_polygon(np.array(corners) * (across, down))
        x, y = x / across, y / down
    else:
        raise LabelError(f"<{shape.tag}> is not a ball", expected="points, box, ellipse, polygon, or a tag for a state")
    # CVAT counts from the picture's corner, we from the middle of the first pixel.
    return context.ball(t_us, state, x * across - HALF_PIXEL, y * down - HALF_PIXEL, radius)


def _read_tracks(video: _Video, context: ImportContext, collector: Collector) -> None:
    """Take the balls of tracks: one for each picture in which the object is not *outside*.

    Between keyframes CVAT writes what it interpolated: such labels are *interpolated*. An object that is outside of
    the picture, or not there yet, is no statement about other balls.
    """
    file = video.file
    try:
        size = _stated_size(video.root)
        factors = scaling_of([size], context, collector).of(stated_size(*size))
    except LabelError as error:
        collector.reject(file, video.root.line, error)
        return
    _note_frames(video.root, collector)
    numbers = sorted(_frames_of(video.tracks))
    outside = 0
    for track in video.tracks:
        with collector.entry(file, track.line):
            name = track.attribute("label")
            if not context.is_ball(name):
                raise LabelError(f"a track of label {name!r}, which is not {context.ball_class or CLASS_NAME!r}")
            held = _held_shapes(track)
            for shape in track.children:
                if shape.tag == "attribute":
                    continue
                if shape.attributes.get("outside", "0") in TRUE:
                    outside += 1
                    continue
                with collector.entry(file, shape.line):
                    # CVAT repeats the last keyframe to the end of the video, whether or not the ball is there.
                    if shape.line in held and shape.attributes.get("frame") in held[shape.line]:
                        raise LabelError("not a keyframe, and it only repeats the keyframe before")
                    if context.frame_times_us is not None:
                        check_numbers(numbers, context.frame_times_us)
                    t_us = context.time_of_frame(whole_number(shape.attribute("frame"), "the frame"))
                    label = _label_of_shape(shape, t_us, factors, context)
                    if shape.attributes.get("keyframe", "1") not in TRUE:
                        made = dataclasses.replace(label.provenance, source=PositionSource.INTERPOLATED)
                        label = dataclasses.replace(label, provenance=made)
                    collector.add(label, file, shape.line)
    if outside:
        collector.note(f"{counted(outside, 'shape')} of an object that is outside: no label")


def _held_shapes(track: XmlNode) -> dict[int, set[str]]:
    """Lines and frames of shapes that stay where the keyframe before was, though the next one is elsewhere.

    CVAT holds an object so after its last keyframe, up to the end of the video (cvat-ai/cvat#8514), and some versions
    between keyframes (#3879).
    """
    shapes = [shape for shape in track.children if shape.tag != "attribute"]
    places = [tuple(shape.attributes.get(name) for name in PLACE) for shape in shapes]
    keys = [shape.attributes.get("keyframe", "1") in TRUE for shape in shapes]
    held: dict[int, set[str]] = {}
    before: int | None = None
    for at, shape in enumerate(shapes):
        if keys[at]:
            before = at
        elif before is not None and places[at] == places[before]:
            after = next((k for k in range(at + 1, len(shapes)) if keys[k]), None)
            gone = after is None or shapes[after].attributes.get("outside", "0") in TRUE
            if after is None or gone or places[after] != places[before]:
                held.setdefault(shape.line, set()).add(shape.attributes.get("frame", ""))
    return held


def _frames_of(tracks: list[XmlNode]) -> set[int]:
    texts = {shape.attributes.get("frame", "") for track in tracks for shape in track.children}
    return {int(text) for text in texts if text.isdecimal() and len(text) < 12}


def _stated_size(root: XmlNode) -> StatedSize:
    """The size of the video, as <meta><task><original_size> (or <job>) says it."""
    meta = root.child("meta")
    for owner in () if meta is None else (*meta.children, meta):
        size = owner.child("original_size")
        if size is not None:
            return size.value("width"), size.value("height")
    return None, None


def _note_frames(root: XmlNode, collector: Collector) -> None:
    """Say that the task has a part of the video only: its frames keep the numbers of the whole one."""
    meta = root.child("meta")
    for owner in () if meta is None else meta.children:
        start, step = owner.child("start_frame"), owner.child("frame_filter")
        if start is not None and start.text.strip() not in ("", "0"):
            collector.note(f"the task begins at frame {start.text.strip()[:20]} of the video: its numbers are kept")
        if step is not None and step.text.strip():
            collector.note(f"the task has a part of the frames ({step.text.strip()[:40]}): their numbers are kept")
