"""Rallies made in Sony's layout: imported with their reference, and shifts of their labels found."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.cli.main import main
from benchmarks.labels.label_shifts import (
    NAMES,
    Capture,
    DrawnShift,
    make_rally,
    try_shifts,
    write_capture,
    write_labels,
)
from core.recordings import ImportOrder, import_recording, open_recording

CAMERA = NAMES["left"]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return make_rally(tmp_path_factory.mktemp("sony") / "capture", np.random.default_rng(3), 1)


def test_drawn_shifts_are_found_and_none_is_invented(tmp_path: Path) -> None:
    trial = try_shifts(tmp_path, np.random.default_rng(1), rallies=2, draws=2)
    assert trial.found == trial.shifted == 4
    assert trial.said_zero == trial.unshifted == 2
    assert (trial.invented, trial.unrelated) == (0, 2)


def test_the_3d_reference_becomes_the_ground_truth_in_the_tables_frame(capture: Capture) -> None:
    with open_recording(capture.folder / "simulated.h5") as simulated, open_recording(capture.recording) as recording:
        ball, truth = recording.ball, simulated.ball
        assert ball is not None and truth is not None
        first = next(iter(capture.folder.glob(f"h5/{CAMERA}/*_rally.h5")))
        assert first.is_file()
        zero_us = min(int(stream.slice(0, 10**7).t_us[0]) for stream in simulated.cameras.values())
        known = truth.visible
        at = np.interp(ball.t_us + zero_us, truth.t_us[known], truth.p_world_m[known, 0])
        assert len(ball.t_us) > 1000
        assert np.median(np.abs(ball.p_world_m[:, 0] - at)) < 1e-3
        (note,) = [note for note in recording.notes if "ground truth of the ball" in note]
        assert f"metadata/{CAMERA}/{capture.name}.csv" in note and "frame cameras" in note
        assert "the calibration's frame W" in note


@pytest.mark.parametrize("what", ["no labels", "labels elsewhere", "another frame", "columns", "2 ms"])
def test_a_reference_that_cannot_be_placed_is_left_out_with_the_reason(
    capture: Capture, what: str, tmp_path: Path
) -> None:
    with open_recording(capture.folder / "simulated.h5") as simulated:
        write_capture(tmp_path, capture.name, simulated)
    for name in NAMES.values():
        table = tmp_path / "metadata" / name / f"{capture.name}.csv"
        lines = table.read_text().splitlines()
        if what == "no labels":
            (tmp_path / "h5" / name / f"{capture.name}_label.h5").unlink()
        elif what == "labels elsewhere":
            labels = tmp_path / "h5" / name / f"{capture.name}_label.h5"
            labels.rename(tmp_path / f"{name}.h5")
            with h5py.File(labels, "w") as file:
                file["points"] = h5py.ExternalLink(str(tmp_path / f"{name}.h5"), "/points")
        elif what == "another frame":
            rows = [line.split(",") for line in lines[1:]]
            far = [",".join([t, *(f"{float(x) + 9:.6f}" if x else "" for x in p), *v]) for t, *p, v in
                   ([row[0], *row[1:4], row[4:]] for row in rows)]  # fmt: skip
            table.write_text("\n".join([lines[0], *far]))
        elif what == "columns":
            table.write_text("\n".join([lines[0].replace("pos_x_label", "x"), *lines[1:]]))
        else:
            table.write_text("\n".join([lines[0], *lines[1::2]]))
    import_recording(ImportOrder([tmp_path / "h5"]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        assert recording.ball is None
        notes = [note for note in recording.notes if "is left out" in note]
        assert len(notes) == 2
        reason = {
            "no labels": "not beside",
            "labels elsewhere": "a link to another file",
            "columns": "expected the columns",
            "2 ms": "not 1 ms apart",
        }
        assert reason.get(what, "in no frame it fits") in notes[0]


def test_the_command_finds_a_shift_moves_the_labels_and_writes_them_back(
    capture: Capture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = DrawnShift(-12_000, 9.0, -4.0)
    labels = capture.folder / "h5" / CAMERA / f"{capture.name}_label.h5"
    with open_recording(capture.recording) as recording:
        write_labels(labels, capture.truth, drawn, recording.duration_us)
    common = [str(capture.recording), "--camera", CAMERA, "--data", str(tmp_path / "data"), "--json"]

    def call(*words: str) -> dict:
        assert main(["labels", *words]) == 0
        return json.loads(capsys.readouterr().out)

    taken = call("import", str(capture.folder), *common, "--format", "sony")
    assert taken["annotator"] == "imported" and taken["imported"] > 1000
    shift = call("shift", *common, "--apply")
    assert shift["applied_as"] == "imported-shifted"
    assert shift["dt_us"] == pytest.approx(drawn.dt_us, abs=300)
    assert (shift["du_px"], shift["dv_px"]) == pytest.approx((drawn.du_px, drawn.dv_px), abs=0.3)
    out = tmp_path / "out"
    written = call("export", *common, "--annotator", "imported-shifted", "--format", "sony", "--out", str(out))
    again = call("import", str(out), *common, "--annotator", "back", "--format", "sony")
    assert again["imported"] == written["labels"] and again["rejected"] == []


def test_of_several_rallies_in_a_folder_the_labels_of_the_recordings_own_are_taken(
    capture: Capture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_recording(capture.folder / "simulated.h5") as simulated:
        write_capture(tmp_path, "seq_001_rally", simulated)
        write_capture(tmp_path, "seq_002_rally", simulated, DrawnShift(0, 100.0, 0.0))
        uvs = simulated.cameras["left"].truth
    for name in NAMES.values():
        with h5py.File(tmp_path / "h5" / name / "seq_002_rally.h5", "r+") as file:
            file["t0"][0] += 60_000_000
    files = [str(tmp_path / "h5" / name / "seq_002_rally.h5") for name in NAMES.values()]
    assert main(["import", *files, str(tmp_path / "two.h5"), "--names", ",".join(NAMES.values())]) == 0
    common = [str(tmp_path / "two.h5"), "--camera", CAMERA, "--data", str(tmp_path / "data"), "--json"]
    capsys.readouterr()
    assert main(["labels", "import", str(tmp_path), *common, "--format", "sony"]) == 0
    example = json.loads(capsys.readouterr().out)["examples"][0]
    with open_recording(tmp_path / "two.h5") as recording:
        zero_us = int(recording.cameras[CAMERA].t_offset_us) % 1_000_000
    at = uvs.at(np.array([example["t_us"] + zero_us]))
    assert example["x_px"] + 100.0 == pytest.approx(float(at.u_px[0]), abs=0.5)
    assert main(["import", str(tmp_path / "h5"), str(tmp_path / "all.h5")]) == 2
    assert "seq_001_rally.h5, seq_002_rally.h5" in capsys.readouterr().err
