"""Exchange formats: one small file each, all with the same two functions, `write` and `read`."""

from typing import Final

from labels.formats.coco import COCO
from labels.formats.cvat import CVAT
from labels.formats.exchange import (
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelFormat,
    LabelSet,
    Rejection,
)
from labels.formats.plain_csv import PLAIN_CSV
from labels.formats.recording_group import HDF5
from labels.formats.sony import SONY
from labels.formats.tracknet import TRACKNET
from labels.formats.voc import VOC
from labels.formats.yolo import YOLO, YOLO_POSE

FORMATS: Final[dict[str, LabelFormat]] = {
    item.name: item for item in (VOC, YOLO, YOLO_POSE, COCO, TRACKNET, CVAT, PLAIN_CSV, HDF5, SONY)
}

__all__ = [
    "FORMATS",
    "ExportOptions",
    "Exported",
    "ImportContext",
    "Imported",
    "LabelFormat",
    "LabelSet",
    "Rejection",
]
