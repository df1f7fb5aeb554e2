"""Pascal VOC as LabelImg 1.8 writes it: one XML a picture, boxes of whole pixels.

LabelImg's boxes are edges counted from 0, truncated to whole pixels, and at least 1. Ours are rounded, which halves the
error (0.24 px instead of 0.74 on average) and has no bias. What LabelImg made is read without the half pixel between
its edges and our pixel centres: on average the truncation has taken it off already.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from core.errors import LabelError
from labels.formats.boxes import Box, box_of, losses_of_box
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
    write_text,
)
from labels.formats.labelled_pictures import DrawnShape, Picture, Place, add_pictures, parse_files, stated_size
from labels.model import Label, LabelState

EXTRA = "ballcentre"


def write_voc(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """One XML file for each label."""
    files, losses = [], []
    for label in labels.labels:
        name = picture_name(labels.camera, label.t_us)
        box = box_of(label, labels.sensor, options.default_radius_px)
        if not options.own_extras:
            losses += losses_of_box(label, box)
            losses += [f"state {label.state}"] if label.state not in (LabelState.VISIBLE, LabelState.NO_BALL) else []
            losses += ["position rounded to whole pixels"] if box and options.whole_pixels else []
        files.append(write_text(folder / f"{name}.xml", _document(labels, label, box, folder.name, name, options)))
    return Exported(tuple(files), (*count_losses(losses), *(("provenance and covariance",) if labels.labels else ())))


def _document(labels: LabelSet, label: Label, box: Box | None, folder: str, name: str, options: ExportOptions) -> str:
    lines = [
        "<annotation>",
        f"\t<folder>{escape(folder)}</folder>",
        f"\t<filename>{escape(name)}.png</filename>",
        f"\t<path>{escape(name)}.png</path>",
        "\t<source>",
        "\t\t<database>Unknown</database>",
        "\t</source>",
        "\t<size>",
        f"\t\t<width>{labels.sensor.width_px}</width>",
        f"\t\t<height>{labels.sensor.height_px}</height>",
        "\t\t<depth>1</depth>",
        "\t</size>",
        "\t<segmented>0</segmented>",
    ]
    if box is not None:
        lines += _object(label, box, labels, options)
    elif options.own_extras:
        lines.append(f"\t{_extra(label)}")
    return "\n".join([*lines, "</annotation>", ""])


def _object(label: Label, box: Box, labels: LabelSet, options: ExportOptions) -> list[str]:
    edges = (max(box.x0, 1.0), max(box.y0, 1.0), box.x1, box.y1)
    if options.whole_pixels:
        texts = [str(int(edge + 0.5)) for edge in edges]
        edges = tuple(float(text) for text in texts)
    else:
        texts = [f"{edge:.4f}" for edge in edges]
    at_edge = edges[0] <= 1 or edges[1] <= 1 or edges[2] >= labels.sensor.width_px
    truncated = box.clipped or at_edge or edges[3] >= labels.sensor.height_px
    return [
        "\t<object>",
        f"\t\t<name>{CLASS_NAME}</name>",
        "\t\t<pose>Unspecified</pose>",
        f"\t\t<truncated>{int(truncated)}</truncated>",
        f"\t\t<difficult>{int(label.state is not LabelState.VISIBLE)}</difficult>",
        "\t\t<bndbox>",
        *(f"\t\t\t<{tag}>{text}</{tag}>" for tag, text in zip(("xmin", "ymin", "xmax", "ymax"), texts, strict=True)),
        "\t\t</bndbox>",
        *([f"\t\t{_extra(label)}"] if options.own_extras else []),
        "\t</object>",
    ]


def _extra(label: Label) -> str:
    values = {"t_us": label.t_us, "state": label.state, "x": label.x_px, "y": label.y_px, "r": label.r_px}
    known = " ".join(f"{name}={quoteattr(str(value))}" for name, value in values.items() if value is not None)
    return f"<{EXTRA} {known}/>"


def read_voc(path: Path, context: ImportContext) -> Imported:
    """Every XML file of a folder, or one: a picture each."""
    collector = Collector()
    add_pictures(parse_files(path, ".xml", context, collector, _pictures_in), context, collector)
    return collector.done()


def _pictures_in(text: str, file: Path, context: ImportContext, collector: Collector) -> list[Picture]:
    root = parse_xml(text)
    with collector.entry(file, root.line):
        return [_picture_of(root, file, context)]
    return []


def _picture_of(root: XmlNode, file: Path, context: ImportContext) -> Picture:
    if root.tag != "annotation":
        raise LabelError("not a Pascal VOC file", expected="<annotation>", got=f"<{root.tag}>")
    picture, size = root.child("filename"), root.child("size")
    name = picture.text.strip() if picture is not None and picture.text.strip() else file.name
    name = f"{file.parent.name}/{name}" if "/" not in name else name
    edges = [None if size is None else size.child(tag) for tag in ("width", "height")]
    width, height = (None if edge is None else edge.text.strip() for edge in edges)
    stated_size(width, height)  # a size that is none rejects the file: nothing of it can be trusted
    shapes = [DrawnShape(item.line, partial(_label_of, item, context)) for item in root.all("object")]
    extra = root.child(EXTRA)
    if extra is not None and not shapes:
        shapes = [DrawnShape(extra.line, lambda place: _label_of_extra(extra, context, place))]

    def whole(place: Place) -> Label | None:
        place.check_size()
        if shapes:
            return None
        unsure = _lists_unannotated(root) or context.empty_pictures is not None
        return context.unannotated(place.t_us) if unsure else context.make(place.t_us, LabelState.NO_BALL)

    return Picture(
        file=file,
        line=root.line,
        names=(name, f"{file.parent.name}/{file.name}"),
        size=(width, height),
        whole=whole,
        shapes=shapes,
    )


def _label_of(item: XmlNode, context: ImportContext, place: Place) -> Label:
    if not context.is_ball(item.value("name")):
        raise LabelError(f"class {item.value('name')!r} is not {context.ball_class or CLASS_NAME!r}")
    extra, factors = item.child(EXTRA), place.factors
    if extra is None or factors != (1.0, 1.0):
        return _label_of_box(item, place.t_us, factors, context)
    return _label_of_extra(extra, context, place)


def _lists_unannotated(root: XmlNode) -> bool:
    """Whether the tool writes files of pictures that nobody looked at: CVAT does (cvat-ai/cvat#7643), and says more of
    its source than others.
    """
    source = root.child("source")
    return source is not None and (source.child("annotation") is not None or source.child("image") is not None)


def _label_of_extra(extra: XmlNode, context: ImportContext, place: Place) -> Label:
    place.check_camera()
    x, y, r = (finite(extra.attributes[name], name) if name in extra.attributes else None for name in ("x", "y", "r"))
    return context.make(int(extra.attribute("t_us")), LabelState(extra.attribute("state")), x, y, r)


def _label_of_box(item: XmlNode, t_us: int, factors: tuple[float, float], context: ImportContext) -> Label:
    bounds = item.child("bndbox")
    if bounds is None:
        raise LabelError("<object> has no <bndbox>")
    texts = [bounds.value(tag) for tag in ("xmin", "ymin", "xmax", "ymax")]
    x0, y0, x1, y1 = (finite(text, "an edge of the box") for text in texts)
    if x1 <= x0 or y1 <= y0:
        raise LabelError("the box is empty", got=(x0, y0, x1, y1))
    shift = 0.0 if all(edge.is_integer() for edge in (x0, y0, x1, y1)) else HALF_PIXEL
    flags = [item.child(tag) for tag in ("difficult", "occluded", "truncated")]
    partly = any(flag is not None and flag.text.strip().lower() not in ("", "0", "false") for flag in flags)
    state = LabelState.PARTLY_OCCLUDED if partly else LabelState.VISIBLE
    across, down = factors
    x, y = ((x0 + x1) / 2 - shift + HALF_PIXEL) * across, ((y0 + y1) / 2 - shift + HALF_PIXEL) * down
    radius = ((x1 - x0) * across + (y1 - y0) * down) / 4
    return context.ball(t_us, state, x - HALF_PIXEL, y - HALF_PIXEL, radius)
