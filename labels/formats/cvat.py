"""CVAT XML 1.1 for images: points with two decimals, counted from the picture's corner; states as tags, attributes."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from core.errors import LabelError
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
    count_losses,
    files_at,
    finite,
    picture_name,
    read_text,
    stated_size,
    whole_number,
    write_text,
)
from labels.formats.xml_nodes import XmlError, XmlNode, parse_xml
from labels.model import Label, LabelState

FILE = "annotations.xml"
STATE, RADIUS = "state", "r_px"
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
    for file in files_at(path, ".xml", collector):
        text = read_text(file, collector)
        if text is None:
            continue
        try:
            root = parse_xml(text)
        except XmlError as error:
            collector.reject(file, error.line, error)
            continue
        if root.tag != "annotations":
            collector.reject(file, root.line, f"not a CVAT file; expected <annotations>, got <{root.tag}>")
            continue
        for item in root.children:
            if item.tag == "image":
                images.append((item, file))
            elif item.tag not in ("version", "meta"):
                collector.reject(file, item.line, f"<{item.tag}> is not read; export CVAT for images, not for video")
    times = context.pictures(image.attributes.get("name", "") for image, _ in images)
    scaling = context.scaling((_size_of(image) for image, _ in images), collector)
    for image, file in images:
        _read_image(image, file, times, scaling, context, collector)
    return collector.done()


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
            collector.add(context.make(t_us, LabelState.NO_BALL), file, image.line)
        for shape in image.children:
            with collector.entry(file, shape.line):
                collector.add(_label_of(shape, t_us, factors, context), file, shape.line)


def _label_of(shape: XmlNode, t_us: int, factors: tuple[float, float], context: ImportContext) -> Label:
    name = shape.attribute("label")
    if shape.tag == "tag" and name in _TAGS:
        return context.make(t_us, _TAGS[name])
    if not context.is_ball(name):
        raise LabelError(f"label {name!r} is not {context.ball_class or CLASS_NAME!r}")
    attributes = {item.attribute("name"): item.text.strip() for item in shape.all("attribute")}
    state = LabelState.PARTLY_OCCLUDED if shape.attributes.get("occluded", "0") != "0" else LabelState.VISIBLE
    state = LabelState(attributes[STATE]) if STATE in attributes else state
    radius = finite(attributes[RADIUS], RADIUS) if attributes.get(RADIUS) else None
    across, down = factors
    radius = None if radius is None else radius * (across + down) / 2
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
    else:
        raise LabelError(f"<{shape.tag}> is not a ball", expected="points, box, ellipse, or a tag for a state")
    return context.ball(t_us, state, x * across - HALF_PIXEL, y * down - HALF_PIXEL, radius)
