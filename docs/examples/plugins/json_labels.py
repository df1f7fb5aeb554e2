"""A format of labels of your own: `rallyscope labels export ... --format json-points --plugin json_labels.py`.

One file, {"camera": NAME, "labels": [{"t_us", "state", "x_px", "y_px", "r_px"}, ...]}; null where a label has nothing.
"""

import json
from pathlib import Path

from core.text import parse_json
from labels.formats import ExportOptions, ImportContext, Imported, LabelSet, register_label_format
from labels.formats.exchange import Collector, Exported, count_losses, files_at, finite, read_text, write_text
from labels.model import LabelState

NAME = "labels.json"
NUMBERS = ("x_px", "y_px", "r_px")


def write(labels: LabelSet, out: Path, options: ExportOptions) -> Exported:
    """Write every label, and say how often something was left out."""
    rows = [
        {"t_us": one.t_us, "state": str(one.state), **{name: getattr(one, name) for name in NUMBERS}}
        for one in labels.labels
    ]
    file = write_text(out / NAME, json.dumps({"camera": labels.camera, "labels": rows}, indent=1))
    return Exported((file,), count_losses("a covariance" for one in labels.labels if one.covariance_px2 is not None))


def read(path: Path, context: ImportContext) -> Imported:
    """Read a file, or all of a folder; every entry becomes a label or is rejected with its reason."""
    collector = Collector()
    for file in files_at(path, ".json", collector):
        text = read_text(file, collector)
        if text is None:
            continue
        try:
            rows = list(parse_json(text)["labels"])
        except (ValueError, KeyError, TypeError) as error:
            collector.reject(file, 1, f"not a file of labels: {error}")
            continue
        for number, row in enumerate(rows, start=1):
            with collector.entry(file, number):
                numbers = [None if row[name] is None else finite(row[name], name) for name in NUMBERS]
                collector.add(context.make(row["t_us"], LabelState(row["state"]), *numbers), file, number)
    return collector.done()


register_label_format("json-points", write, read, "JSON points", "one JSON file with every label")
