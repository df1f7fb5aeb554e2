"""Labels written, exported, imported and scored: `python docs/examples/labels_in_and_out.py [RECORDING]`."""

import tempfile
from pathlib import Path

from small_input import recording_path

from core.detection import make_detector
from core.recordings import open_recording
from labels import FORMATS, ExportOptions, ImportContext, Label, LabelSet, LabelState, LabelStore, score_labels

with open_recording(recording_path()) as recording, tempfile.TemporaryDirectory() as folder:
    camera = next(iter(recording.cameras.values()))
    truth = camera.truth
    assert truth is not None, "this example labels with the truth that simulated recordings have"
    labels = [
        Label(
            t_us=int(truth.t_us[row]),
            state=LabelState.VISIBLE,
            x_px=float(truth.u_px[row]),
            y_px=float(truth.v_px[row]),
            r_px=float(truth.r_px[row]),
        )
        for row in truth.visible.nonzero()[0][::20]
    ]
    with LabelStore.open(Path(folder), recording.uuid, camera.name, "me") as store:
        store.edit(put=labels)  # one step: one undo takes all of them back
        print(f"{len(store.all())} labels are on the disk")
        own = LabelSet(recording.uuid, camera.name, "me", camera.sensor, store.all())
        columns = store.labels()

    coco = FORMATS["coco"]
    written = coco.write(own, Path(folder) / "coco", ExportOptions())
    print(f"exported: {', '.join(file.name for file in written.files)}")
    read = coco.read(Path(folder) / "coco", ImportContext(camera.sensor, camera=camera.name))
    furthest_px = max(abs(one.x_px - two.x_px) for one, two in zip(own.labels, read.labels, strict=True))
    print(f"{len(read.labels)} labels came back, {len(read.rejections)} rejected, at most {furthest_px:.3f} px moved")

    everything, *_ = score_labels(camera, make_detector("auto", camera.sensor), columns, window_us=2000)
    print(f"the detector: recall {everything.at[-1].recall:.2f}, median error {everything.median_px:.2f} px")
