"""CVAT XML 1.1: written for images, points with two decimals counted from the picture's corner, states as tags.

Read are images and the tracks of videos.
"""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from core.errors import LabelError
from labels.formats.cvat_shapes import RADIUS, STATE, Video, label_of_shape, read_tracks
from labels.formats.exchange import (
    CLASS_NAME,
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    PictureScaling,
    PictureTimes,
    SamePictures,
    count_losses,
    files_at,
    picture_name,
    read_text,
    stated_size,
    whole_number,
    write_text,
)
from labels.formats.xml_nodes import XmlError, XmlNode, parse_xml
from labels.model import Label, LabelState

FILE = "annotations.xml"
_TAGS = {state.value: state for state in LabelState if not state.seen}


def write_cvat(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`annotations.xml` in the folder."""
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


def read_cvat(path: Path, context: ImportContext) -> Imported:
    """Every XML file of a folder, or one."""
    collector = Collector()
    images: list[tuple[XmlNode, Path]] = []
    videos: list[Video] = []
    for file in files_at(path, ".xml", collector):
        root = _annotations(file, collector)
        if root is None:
            continue
        listed = [(item, file) for item in root.children if item.tag == "image"]
        tracks = [item for item in root.children if item.tag == "track"]
        images += listed
        videos += [Video(file, root, tracks)] if tracks and not listed else []
        for track in tracks if listed else ():
            collector.reject(file, track.line, "a track among images: export for images or for video, not both")
        for item in root.children:
            if item.tag not in ("version", "meta", "image", "track"):
                collector.reject(file, item.line, f"<{item.tag}> is not read")
    images = _without_repeated_files(images, collector)
    if len(videos) > 1 or (videos and images):
        # Frames of a video have no names, only counts: those of two files are not the same pictures.
        what = "several files, each with its own count of pictures: import one of them"
        for video in videos:
            collector.reject(video.file, 1, what)
        videos = []
    for video in videos:
        read_tracks(video, context, collector)
    times = context.pictures(image.attributes.get("name", "") for image, _ in images)
    scaling = context.scaling((_size_of(image) for image, _ in images), collector)
    for image, file in images:
        _read_image(image, file, times, scaling, context, collector)
    return collector.done()


def _annotations(file: Path, collector: Collector) -> XmlNode | None:
    """The root of a CVAT file; None, and the file rejected, if it is none."""
    text = read_text(file, collector)
    if text is None:
        return None
    try:
        root = parse_xml(text)
    except XmlError as error:
        collector.reject(file, error.line, error)
        return None
    if root.tag != "annotations":
        collector.reject(file, root.line, f"not a CVAT file; expected <annotations>, got <{root.tag}>")
        return None
    return root


def _without_repeated_files(images: list[tuple[XmlNode, Path]], collector: Collector) -> list[tuple[XmlNode, Path]]:
    """The pictures without those of files that annotate the same pictures as another one."""
    same = SamePictures()
    for image, file in images:
        same.add(file, [image.attributes.get("name", "")])
    files = list(dict.fromkeys(file for _, file in images))
    kept = {file for file in files if same.accept(file, collector)}
    return [(image, file) for image, file in images if file in kept]


def _size_of(image: XmlNode) -> tuple[float, float] | None:
    """The stated size; None also if it is none, which is said when the picture is read."""
    try:
        return stated_size(image.attributes.get("width"), image.attributes.get("height"))
    except LabelError:
        return None


def _read_image(
    image: XmlNode,
    file: Path,
    times: PictureTimes,
    scaling: PictureScaling,
    context: ImportContext,
    collector: Collector,
) -> None:
    with collector.entry(file, image.line):
        factors = scaling.of(stated_size(image.attributes.get("width"), image.attributes.get("height")))
        index = whole_number(image.attributes["id"], "the image's id") if image.attributes.get("id") else None
        t_us = times.time_of(image.attribute("name"), index)
        if not image.children:
            collector.add(context.unannotated(t_us), file, image.line)
        for shape in image.children:
            with collector.entry(file, shape.line):
                collector.add(_label_of(shape, t_us, factors, context), file, shape.line)


def _label_of(shape: XmlNode, t_us: int, factors: tuple[float, float], context: ImportContext) -> Label:
    name = shape.attribute("label")
    if shape.tag == "tag" and name in _TAGS:
        return context.make(t_us, _TAGS[name])
    if not context.is_ball(name):
        raise LabelError(f"label {name!r} is not {context.ball_class or CLASS_NAME!r}")
    return label_of_shape(shape, t_us, factors, context)
