"""Exchange formats: one small file each, all with the same two functions, `write` and `read`."""

from labels.formats.coco import read_coco, write_coco
from labels.formats.cvat import read_cvat, write_cvat
from labels.formats.exchange import (
    FORMATS,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelFormat,
    LabelSet,
    Rejection,
    register_label_format,
)
from labels.formats.label_studio import read_label_studio, write_label_studio
from labels.formats.openttgames import read_openttgames, write_openttgames
from labels.formats.plain_csv import read_csv, write_csv
from labels.formats.plain_json import read_json, write_json
from labels.formats.recording_group import read_hdf5, write_hdf5
from labels.formats.sony import read_sony, write_sony
from labels.formats.tracknet import read_tracknet, write_tracknet
from labels.formats.voc import read_voc, write_voc
from labels.formats.yolo import read_yolo, write_yolo, write_yolo_pose

register_label_format("voc", write_voc, read_voc, "Pascal VOC", "Pascal VOC XML as LabelImg writes it", pictures=True)
register_label_format("yolo", write_yolo, read_yolo, "YOLO", "YOLO text files with boxes", pictures=True)
register_label_format(
    "yolo-pose", write_yolo_pose, read_yolo, "YOLO pose", "YOLO text files with the centre as a keypoint", pictures=True
)
register_label_format("coco", write_coco, read_coco, "COCO", "COCO keypoints JSON", pictures=True, contacts=True)
register_label_format("tracknet", write_tracknet, read_tracknet, "TrackNet", "TrackNetV2/V3 CSV", pictures=True)
register_label_format(
    "openttgames",
    write_openttgames,
    read_openttgames,
    "OpenTTGames",
    "OpenTTGames markup: ball_markup.json and events_markup.json",
    contacts=True,
)
register_label_format("cvat", write_cvat, read_cvat, "CVAT", "CVAT XML 1.1 for images", pictures=True)
register_label_format(
    "label-studio",
    write_label_studio,
    read_label_studio,
    "Label Studio",
    "Label Studio JSON or JSON-MIN",
    pictures=True,
)
register_label_format(
    "csv",
    write_csv,
    read_csv,
    "CSV, nothing is lost",
    "plain CSV with every field; read is a 2D track (t_us, dt_us or frame, x, y) too",
    contacts=True,
)
register_label_format(
    "json", write_json, read_json, "JSON, nothing is lost", "plain JSON with every field", contacts=True
)
register_label_format("hdf5", write_hdf5, read_hdf5, "", "the group /labels/<camera> of a recording", contacts=True)
register_label_format(
    "sony", write_sony, read_sony, "", "Sony's rallies: HDF5 with a label each millisecond", contacts=True
)
FORMATS.mark_built_in()

__all__ = [
    "FORMATS",
    "ExportOptions",
    "Exported",
    "ImportContext",
    "Imported",
    "LabelFormat",
    "LabelSet",
    "Rejection",
    "register_label_format",
]
