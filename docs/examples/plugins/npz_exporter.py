"""An export of your own: `rallyscope export REC --npz EVENTS.npz --plugin npz_exporter.py`.

The events of every camera as NumPy arrays: left_t_us, left_x_px, left_y_px, left_on, and so on.
"""

from pathlib import Path

import numpy as np

from app.export.formats import ExportTask, register_exporter
from app.export.unfinished import check_cancelled, unfinished_file


def export(task: ExportTask) -> tuple[Path, ...]:
    """Write the part that was asked for; the file appears when it is complete."""
    columns: dict[str, np.ndarray] = {}
    cameras = task.recording.cameras
    for number, (name, stream) in enumerate(cameras.items(), start=1):
        check_cancelled(task.cancelled)
        events = stream.slice(task.span.start_us, task.span.end_us)
        columns |= {f"{name}_t_us": events.t_us, f"{name}_x_px": events.x_px}
        columns |= {f"{name}_y_px": events.y_px, f"{name}_on": events.on}
        task.progress(0.9 * number / len(cameras))
    with unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **columns)
    return (task.path,)


register_exporter("npz", export, "NumPy arrays (.npz)", ".npz", what="the events of every camera as NumPy arrays")
