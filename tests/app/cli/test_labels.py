from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from benchmarks.labels.assistance import MIDDLE_US, SENSOR, draw_clip
from core.events import Events
from core.recordings import RecordingWriter, open_recording
from labels.conflicts import settlement
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer, find_layers
from labels.store_contents import read_store

UUID = "11111111-2222-4333-8444-555555555555"


@pytest.fixture(scope="module")
def clip():
    return draw_clip(np.random.default_rng(3), speed_mps=5.0, radius_px=9.0)


@pytest.fixture
def recording(tmp_path: Path, clip) -> Path:
    path = tmp_path / "rec.h5"
    with RecordingWriter(path, {"left": SENSOR, "right": SENSOR}, uuid=UUID) as writer:
        writer.append("left", clip.events)
        writer.append("right", Events.empty(SENSOR))
    return path


@pytest.fixture
def data(tmp_path: Path, clip) -> Path:
    folder = tmp_path / "data"
    x, y = float(clip.truth.u_px[0]), float(clip.truth.v_px[0])
    with LabelStore.open(folder / "labels", UUID, "left", "anna") as store:
        for step in range(-4, 5):
            t_us = MIDDLE_US + step * 1000
            vx, vy = (clip.v_px_per_ms * step).tolist()
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x + vx, y_px=y + vy, r_px=9.0))
    return folder


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    code = main(["labels", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def common(recording: Path, data: Path) -> list[object]:
    return [recording, "--camera", "left", "--data", data]


@pytest.mark.parametrize(
    "name",
    [
        *("voc", "yolo", "yolo-pose", "coco", "tracknet", "openttgames", "cvat", "label-studio", "csv", "json"),
        *("hdf5", "sony"),
    ],
)
def test_labels_go_out_and_come_back(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, name: str
) -> None:
    out = tmp_path / ("out.h5" if name == "hdf5" else "out")
    code, text, _ = call(capsys, "export", *common(recording, data), "--format", name, "--out", out, "--json")
    assert code == 0
    assert json.loads(text)["labels"] == 9
    code, text, _ = call(
        capsys, "import", out, *common(recording, data), "--annotator", "bea", "--format", name, "--json"
    )
    assert code == 0
    report = json.loads(text)
    assert (report["imported"], report["already_there"], report["rejected"]) == (9, 0, [])
    code, text, _ = call(capsys, "agree", *common(recording, data), "--annotator", "anna", "--with", "bea", "--json")
    assert code == 0
    assert json.loads(text)["p95_px"] < 0.71


def test_an_import_keeps_what_is_there_and_is_one_step_of_undo(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "a.csv"
    table.write_text(f"t_us,state,x_px,y_px\n{MIDDLE_US},visible,1,1\n7,visible,2,2\n8,visible,x,2\n")
    code, out, _ = call(capsys, "import", table, *common(recording, data), "--annotator", "anna", "--format", "csv")
    assert code == 0
    assert out.splitlines()[0] == "1 label imported for 'anna', 1 were there already, 1 rejected"
    assert out.splitlines()[1].startswith(f"{table}:4: ")
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        assert len(store.labels()) == 10
        store.undo()
        assert len(store.labels()) == 9


def test_pictures_are_drawn_beside_the_labels(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code, _, _ = call(capsys, "export", *common(recording, data), "--format", "yolo", "--out", out, "--pictures")
    assert code == 0
    pictures = sorted(file.stem for file in out.glob("*.png"))
    assert len(pictures) == 9
    assert all((out / f"{stem}.txt").is_file() for stem in pictures)


def test_a_detector_is_scored_against_the_labels(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path
) -> None:
    code, text, _ = call(capsys, "score", *common(recording, data), "--json")
    assert code == 0
    report = json.loads(text)
    everything = report["rows"][0]
    assert (everything["group"], everything["labels"]) == ("all", 9)
    assert everything["at"][3]["recall"] > 0.5
    assert report["annotator_noise"] is None
    with LabelStore.open(data / "labels", UUID, "left", "anna", blind=True) as blind:
        blind.put(Label(t_us=MIDDLE_US, state=LabelState.VISIBLE, x_px=160.0, y_px=120.0))
    code, text, _ = call(capsys, "score", *common(recording, data))
    assert code == 0
    assert "annotator noise: median" in text
    code, text, _ = call(capsys, "score", *common(recording, data), "--streaming", "--delay-us", "2000", "--json")
    assert code == 0
    again = json.loads(text)
    in_time = again.pop("streaming")
    assert again["rows"] == report["rows"] and in_time["delay_us"] >= 2000
    held, moved = in_time["held"][0], in_time["moved"][0]
    assert held["labels"] == moved["labels"] == 9
    assert held["along_px"] < everything["along_px"] - 1, "it is where the ball was"
    assert moved["median_px"] < held["median_px"]
    code, text, _ = call(capsys, "agree", *common(recording, data))
    assert code == 0
    assert "blind repeats: 1 common" in text


def test_several_recordings_are_scored_one_by_one_and_together_however_they_are_worked_on(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, clip
) -> None:
    other, uuid = tmp_path / "other.h5", "22222222-2222-4333-8444-555555555555"
    with RecordingWriter(other, {"left": SENSOR}, uuid=uuid) as writer:
        writer.append("left", clip.events)
    missing = [recording, other, "--camera", "left", "--data", data]
    code, out, err = call(capsys, "score", *missing)
    assert (code, out) == (2, "") and "no labels of camera 'left'" in err, "before anything is done"
    with LabelStore.open(data / "labels", uuid, "left", "bea") as store:
        x, y = float(clip.truth.u_px[0]), float(clip.truth.v_px[0])
        store.put(Label(t_us=MIDDLE_US, state=LabelState.VISIBLE, x_px=x + 3.0, y_px=y, r_px=9.0))
    singles = [json.loads(call(capsys, "score", *common(one, data), "--json")[1]) for one in (recording, other)]
    picture = tmp_path / "score.svg"
    told = [call(capsys, "score", *missing, "--json", "--jobs", jobs, "--picture", picture)[1] for jobs in ("1", "2")]
    assert told[0] == told[1] and "10 labels of 2 recordings" in picture.read_text()
    report = json.loads(told[0])
    assert [one.pop("recording") for one in report["recordings"]] == [str(recording), str(other)]
    assert report["recordings"] == singles and [one["annotator"] for one in singles] == ["anna", "bea"]
    everything = report["rows"][0]
    assert (everything["group"], everything["labels"], everything["with_ball"]) == ("all", 10, 10)
    hits = [round(one["rows"][0]["at"][3]["recall"] * one["rows"][0]["labels"]) for one in singles]
    assert everything["at"][3]["recall"] == pytest.approx(sum(hits) / 10) and sum(hits) > 5
    code, text, _ = call(capsys, "score", *missing)
    assert code == 0 and f"{other}: labels 1 by bea, balls 1" in text and "all 2 recordings" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["export", "--format", "voc", "--out", "o"], "which camera"),
        (["export", "--camera", "left", "--format", "voc", "--out", "o", "--annotator", "zoe"], "no labels by 'zoe'"),
        (["export", "--camera", "right", "--format", "voc", "--out", "o"], "no labels of camera 'right'"),
        (["score", "--camera", "left", "--annotator", "zoe"], "no labels by 'zoe'"),
        (["agree", "--camera", "left"], "no second looks; got nothing by 'anna'"),
        (["agree", "--camera", "left", "--with", "zoe"], "no labels"),
        (["export", "--camera", "left", "--format", "paper", "--out", "o"], "invalid choice"),
        (["export", "--camera", "left", "--format", "csv", "--out", "o", "--pictures"], "no pictures"),
        (["export", "--camera", "left", "--format", "tracknet", "--out", "o", "--stride-us", "1000"], "unchecked"),
        (["paint"], "invalid choice"),
    ],
)
def test_bad_requests_are_one_clear_line(
    capsys: pytest.CaptureFixture[str],
    recording: Path,
    data: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(recording.parent)
    code, out, err = call(capsys, words[0], recording, "--data", data, *words[1:])
    assert code == 2
    assert out == ""
    assert message in err
    assert err.count("\n") == 1


def test_a_source_that_is_missing_or_holds_nothing_is_one_clear_line(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    for source, message in ((tmp_path / "nowhere", "no such file"), (tmp_path, "nothing could be imported")):
        code, _, err = call(capsys, "import", source, *common(recording, data), "--format", "cvat")
        assert code == 2
        assert message in err and err.count("\n") == 1


def test_agreement_about_nothing_is_said_in_words(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path
) -> None:
    words = ["agree", *common(recording, data), "--annotator", "anna", "--with", "bea"]
    with LabelStore.open(data / "labels", UUID, "left", "bea") as store:
        store.put(Label(t_us=7, state=LabelState.NO_BALL))
        code, text, _ = call(capsys, *words)
        assert code == 0 and text.splitlines()[1:] == ["no common labels: nothing can be compared"]
        store.put(Label(t_us=MIDDLE_US, state=LabelState.OCCLUDED))
        code, text, _ = call(capsys, *words)
        assert code == 0 and "states: 0 of 1 the same" in text and "no common label in which both" in text
        store.put(Label(t_us=MIDDLE_US, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0))
        code, text, _ = call(capsys, *words)
        assert code == 0 and "kappa not defined" in text and "positions (1)" in text
        assert "nan" not in text
        assert "NaN" not in call(capsys, *words, "--json")[1]


def test_whose_labels_has_to_be_said_when_there_are_several(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    words = ("export", *common(recording, data), "--format", "csv", "--out", tmp_path / "o")
    with LabelStore.open(data / "labels", UUID, "left", "bea") as store:
        assert call(capsys, *words)[0] == 0, "who has only begun a layer has said nothing"
        store.put(Label(t_us=7, state=LabelState.NO_BALL))
    code, _, err = call(capsys, *words)
    assert code == 2
    assert "--annotator with one of anna, bea" in err


def test_pictures_that_are_not_named_by_their_time_need_frame_times(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table, times = tmp_path / "rally_ball.csv", tmp_path / "times.csv"
    table.write_text("Frame,Visibility,X,Y\n0,1,10,20\n1,0,0,0\n")
    times.write_text("frame,t_us\n0,500\n1,1500\n")
    words = ["import", table, *common(recording, data), "--annotator", "bea", "--format", "tracknet"]
    code, _, err = call(capsys, *words)
    assert code == 2 and "--frame-times" in err
    code, _, _ = call(capsys, *words, "--frame-times", times)
    assert code == 0
    with LabelStore.open(data / "labels", UUID, "left", "bea") as store:
        assert store.labels().t_us.tolist() == [500, 1500]
    times.write_text("time\n0\n")
    assert call(capsys, *words, "--frame-times", times)[0] == 2


def test_stores_are_merged_and_conflicts_are_listed(
    capsys: pytest.CaptureFixture[str], data: Path, tmp_path: Path
) -> None:
    with LabelStore.open(tmp_path / "other", UUID, "left", "bea") as store:
        store.put(Label(t_us=MIDDLE_US, state=LabelState.NO_BALL))
        store.put(Label(t_us=5, state=LabelState.NO_BALL))
        other = store.path
    mine = data / "labels" / UUID
    code, text, _ = call(capsys, "merge", mine, other, "--out", tmp_path / "c.sqlite")
    assert code == 0
    first, conflict = text.splitlines()
    assert first.startswith("9 labels merged into") and "1 conflict, 2 labels left out" in first
    assert conflict == f"left {MIDDLE_US} us: anna: visible; bea: no_ball"
    code, text, _ = call(capsys, "merge", mine, other, "--out", tmp_path / "d.sqlite", "--prefer", "bea", "--json")
    report = json.loads(text)
    assert code == 0 and (report["labels"], report["left_out"]) == (10, 1)
    assert report["conflicts"][0]["annotators"] == ["anna", "bea"] and report["recording_uuid"] == UUID
    code, _, err = call(capsys, "merge", mine, other, "--out", tmp_path / "d.sqlite")
    assert code == 2 and "a file already" in err and err.count("\n") == 1
    code, _, err = call(capsys, "merge", mine, "--out", tmp_path / "e.sqlite", "--within-px", "-1")
    assert code == 2 and err.count("\n") == 1


def test_a_conflict_that_was_settled_is_merged_and_compared_as_it_was_before(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    mine, out = data / "labels" / UUID, tmp_path / "c.sqlite"
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        first = store.at(MIDDLE_US)
    assert first is not None
    made = Provenance(source=PositionSource.SETTLED, detector=settlement("anna", first, "mine"))
    for folder in (data / "labels", tmp_path / "other"):
        with LabelStore.open(folder, UUID, "left", "bea") as store:
            store.put(Label(t_us=MIDDLE_US, state=LabelState.NO_BALL, provenance=made))
            other = store.path
    code, text, _ = call(capsys, "merge", mine, other, "--out", out)
    counts, settled = text.splitlines()
    assert code == 0 and "0 conflicts, 1 label left out" in counts
    assert settled == "1 conflict settled in Label: the label that settles each was taken"
    layers = {layer.annotator: times for layer, times in read_store(out).layers.items()}
    assert MIDDLE_US in layers["bea"] and MIDDLE_US not in layers["anna"] and len(layers["anna"]) == 8
    code, text, _ = call(capsys, "agree", *common(recording, data), "--annotator", "anna", "--with", "bea")
    assert code == 0 and "1 label left out: what stood there before" in text and "0 common" in text
    with LabelStore.open(data / "labels", UUID, "left", "bea") as store:
        store.put(Label(t_us=int(MIDDLE_US) + 1, state=LabelState.NO_BALL))
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        store.put(Label(t_us=int(MIDDLE_US) + 1, state=LabelState.NO_BALL))
    text = call(capsys, "agree", *common(recording, data), "--annotator", "anna", "--with", "bea")[1]
    assert "agreement cannot be told without the 1 conflict left out; of the other 1 time 1 the same" in text
    for name in ("anna", "bea"):
        with LabelStore.open(data / "labels", UUID, "left", name) as store:
            store.delete(int(MIDDLE_US) + 1)
    anna = LabelStore.read(data / "labels", Layer(UUID, "left", "anna")).labels()
    with LabelStore.open(data / "labels", UUID, "left", "bea") as store:
        for row in range(4):  # two by hand 3 px off, one snapped to the same circle, one copied
            t_us, x, y = int(anna.t_us[row]), float(anna.x_px[row]), float(anna.y_px[row])
            how = Provenance(source=PositionSource.SNAPPED) if row == 2 else Provenance(annotator="anna" * (row == 3))
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x + 3 * (row < 2), y_px=y, provenance=how))
            if row == 1:
                made = Provenance(source=PositionSource.SETTLED, detector="anna 1: theirs")
                store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=y, provenance=made))
    words = ["agree", *common(recording, data), "--annotator", "anna", "--with", "bea"]
    found = json.loads(call(capsys, *words, "--json")[1])
    assert found["settled_us"] == sorted({int(anna.t_us[1]), MIDDLE_US}) and found["copied"] == 1
    groups = {name: (one["pairs"], one["same_position"]) for name, one in found["by_source"].items()}
    assert groups == {"by_hand": (2, 0), "snapped": (1, 1), "proposed": (0, 0), "other": (1, 1)}
    assert found["by_source"]["by_hand"]["median_px"] == pytest.approx(3.0)
    text = call(capsys, *words)[1]
    assert "conflicts were settled at 2 times: compared as before that" in text and "taken over" in text
    assert "median" not in text.split("by hand")[0], "no figure of clicks and snapped circles together"
    assert "by hand (2): median 3.00 px" in text and "snapped (1): median 0.00 px" in text and "taken twice" in text


def test_a_shift_of_labels_against_the_events_is_measured_and_applied(
    capsys: pytest.CaptureFixture[str], serve_recording: Path, tmp_path: Path
) -> None:
    with open_recording(serve_recording) as recording:
        truth = recording.cameras["left"].truth
        assert truth is not None
        rows = np.flatnonzero(truth.visible)
        columns = (column[rows].tolist() for column in (truth.t_us, truth.u_px, truth.v_px, truth.r_px))
        labels = [
            Label(t_us=t - 6000, state=LabelState.VISIBLE, x_px=u - 3.0, y_px=v + 5.0, r_px=r)
            for t, u, v, r in zip(*columns, strict=True)
            if t >= 6000
        ]
        bounce = ContactLabel(
            t_us=20_000, kind=ContactKind.BOUNCE, provenance=Provenance(window_us=(19_000, 21_000), made_at_us=5)
        )
        with LabelStore.open(tmp_path / "labels", recording.uuid, "left", "anna") as store:
            store.edit(put=labels, put_contacts=[bounce])
        uuid = recording.uuid
    words = [serve_recording, "--camera", "left", "--data", tmp_path, "--method", "refined", "--json"]
    code, text, _ = call(capsys, "shift", *words, "--apply")
    assert code == 0
    found = json.loads(text)
    assert found["found"] and not found["is_zero"]
    assert found["dt_us"] == pytest.approx(6000, abs=300)
    assert (found["du_px"], found["dv_px"]) == (pytest.approx(3.0, abs=0.3), pytest.approx(-5.0, abs=0.3))
    assert found["applied_as"] == "anna-shifted"
    code, text, _ = call(capsys, "shift", *words, "--annotator", "anna-shifted")
    assert json.loads(text)["is_zero"]
    (layer,) = (layer for layer in find_layers(tmp_path / "labels", uuid) if layer.annotator == "anna-shifted")
    moved = LabelStore.read(tmp_path / "labels", layer).all()
    assert len(moved) == len(labels)
    assert moved[0].x_px == pytest.approx(labels[0].x_px + found["du_px"])
    (contact,) = LabelStore.read(tmp_path / "labels", layer).contacts()
    later_us = round(found["dt_us"])
    assert contact.t_us == 20_000 + later_us
    assert contact.provenance.window_us == (19_000 + later_us, 21_000 + later_us)
    code, _, err = call(capsys, "shift", *words, "--annotator", "anna", "--apply")
    assert code == 2
    assert "there are moved labels already" in err


def test_a_check_of_an_import_has_its_figures_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "a.csv"
    table.write_text(f"t_us,state,x_px,y_px\n{MIDDLE_US},visible,1,1\n7,visible,2,2\n9,no_ball,,\n8,visible,x,2\n")

    def written() -> dict[Path, bytes]:
        """All files with content, but SQLite's index of readers."""
        files = (path for path in data.rglob("*") if path.is_file() and not path.name.endswith("-shm"))
        return {path: content for path in files if (content := path.read_bytes())}

    before = written()
    found = {}
    for name in ("anna", "bea"):
        words = ["import", table, *common(recording, data), "--format", "csv", "--annotator", name]
        code, text, _ = call(capsys, *words, "--check")
        assert code == 0 and "would be imported" in text and text.endswith("Nothing was written.\n")
        code, text, _ = call(capsys, *words, "--check", "--json")
        assert code == 0
        found[name] = json.loads(text)
    assert written() == before
    assert (found["anna"]["imported"], found["anna"]["already_there"], len(found["anna"]["rejected"])) == (2, 1, 1)
    assert (found["bea"]["imported"], found["bea"]["already_there"]) == (3, 0)
    assert found["bea"]["states"] == {"no_ball": 1, "visible": 2}
    assert (found["bea"]["first_us"], found["bea"]["last_us"]) == (7, MIDDLE_US)
    for name in ("anna", "bea"):
        words = ["import", table, *common(recording, data), "--format", "csv", "--annotator", name, "--json"]
        assert json.loads(call(capsys, *words)[1]) == found[name]


def test_contacts_go_out_come_back_and_are_compared(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "contacts.csv"
    table.write_text(f"t_us,kind\n{MIDDLE_US},bounce\n{MIDDLE_US + 4000},HIT\n9,serve\n{10**12},net\n")
    words = ["import", table, *common(recording, data), "--format", "csv", "--annotator", "bea"]
    code, text, _ = call(capsys, *words, "--json")
    found = json.loads(text)
    assert code == 0 and found["contacts"] == 2 and found["imported"] == 0
    assert len(found["rejected"]) == 2 and "contacts.csv:4: unknown kind of contact" in " ".join(found["rejected"])
    assert "0 of 2 contacts imported" in call(capsys, *words)[1], "those that are there are not doubled"
    moved = ContactLabel(t_us=MIDDLE_US + 500, kind=ContactKind.BOUNCE)
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        store.edit(put_contacts=[moved])
    words = ["agree", *common(recording, data), "--annotator", "anna", "--with", "bea"]
    found = json.loads(call(capsys, *words, "--json")[1])["contacts"]
    assert (found["common"], found["only_second"], found["time"]["median_us"]) == (1, 1, 500)
    assert "bounce (1): median 0.50 ms" in call(capsys, *words)[1]
    words = ["export", *common(recording, data), "--annotator", "bea", "--out", tmp_path / "out"]
    assert json.loads(call(capsys, *words, "--format", "csv", "--json")[1])["contacts"] == 2
    assert (tmp_path / "out" / "left.contacts.csv").read_text().splitlines()[1].startswith(f"{MIDDLE_US},bounce,")
    losses = json.loads(call(capsys, *words, "--format", "tracknet", "--json")[1])["losses"]
    assert "2 x contact (bounce, hit, net)" in losses


@pytest.mark.parametrize("name", ["csv", "json", "coco", "voc", "yolo", "cvat"])
def test_labels_of_another_camera_are_not_taken(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, name: str
) -> None:
    out = tmp_path / "out"
    assert call(capsys, "export", *common(recording, data), "--format", name, "--out", out)[0] == 0
    words = (recording, "--camera", "right", "--data", data, "--annotator", "bea", "--format", name)
    code, _, err = call(capsys, "import", out, *words)
    assert code == 2 and re.search("of another camera|a picture of camera 'left'", err) and "\n" not in err.strip()
    # Nobody has said anything by that: `anna` is still the only one.
    code, text, _ = call(capsys, "export", *common(recording, data), "--format", "csv", "--out", tmp_path / "again")
    assert code == 0 and text.startswith("9 labels")


@pytest.mark.parametrize("name", ["json", "coco", "hdf5"])
def test_labels_of_another_recording_are_noted(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, clip, name: str
) -> None:
    out = tmp_path / ("out.h5" if name == "hdf5" else "out")
    assert call(capsys, "export", *common(recording, data), "--format", name, "--out", out)[0] == 0
    other = tmp_path / "other.h5"
    with RecordingWriter(other, {"left": SENSOR}, uuid="22222222-2222-4333-8444-555555555555") as writer:
        writer.append("left", clip.events)
    code, text, _ = call(capsys, "import", out, *common(other, data), "--format", name)
    assert code == 0 and text.startswith("9 labels imported") and "says that it is of another recording" in text
    code, text, _ = call(capsys, "import", out, *common(recording, data), "--annotator", "bea", "--format", name)
    assert code == 0 and "another recording" not in text


def test_a_name_in_other_letters_is_no_second_person(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "a.csv"
    table.write_text("t_us,state,x_px,y_px\n7,visible,2,2\n")
    words = ("import", table, *common(recording, data), "--format", "csv", "--annotator")
    code, _, err = call(capsys, *words, "Anna")
    assert code == 2 and "a name in other letters; expected 'anna', who has labels, got Anna" in err
    assert call(capsys, *words, "anna")[0] == 0


def test_a_header_in_capitals_is_read_as_ours(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "a.csv"
    table.write_text("T_us,State,X_px,Y_px\n7,visible,2,2\n8,occluded,3,3\n9,no_ball,,\n")
    code, text, _ = call(capsys, "import", table, *common(recording, data), "--format", "csv", "--check", "--json")
    assert code == 0 and json.loads(text)["states"] == {"visible": 1, "occluded": 1, "no_ball": 1}


def test_nothing_is_measured_or_written_of_what_is_left_of_a_damaged_store(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        for t_us in range(2000):  # so that there are pages behind the first
            store.put(Label(t_us=t_us, state=LabelState.NO_BALL))
        path = store.path
    content = bytearray(path.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    for words in (("export", "--format", "csv", "--out", tmp_path / "out"), ("score",), ("agree", "--with", "anna")):
        code, out, err = call(capsys, words[0], *common(recording, data), *words[1:])
        assert code == 2 and not out and "damaged" in err and "labels merge" in err
    assert call(capsys, "merge", path, "--out", tmp_path / "saved.sqlite")[0] == 0


def test_files_that_an_earlier_export_has_left_are_told(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert call(capsys, "export", *common(recording, data), "--format", "yolo", "--out", out)[0] == 0
    with LabelStore.open(data / "labels", UUID, "left", "anna") as store:
        store.edit(delete=[MIDDLE_US])
    code, text, _ = call(capsys, "export", *common(recording, data), "--format", "yolo", "--out", out)
    assert code == 0 and "1 file of an earlier export still there, and read with these" in text
    code, text, _ = call(capsys, "export", *common(recording, data), "--format", "yolo", "--out", out, "--json")
    assert [Path(file).stem for file in json.loads(text)["earlier"]] == [f"left_t{MIDDLE_US:012d}us"]


@pytest.mark.parametrize("name", ["tracknet", "cvat"])
def test_a_second_camera_does_not_write_over_the_times_or_labels_of_the_first(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, name: str
) -> None:
    with LabelStore.open(data / "labels", UUID, "right", "anna") as store:
        store.put(Label(t_us=7, state=LabelState.VISIBLE, x_px=3.0, y_px=4.0, r_px=2.0))
    out = tmp_path / "out"
    assert call(capsys, "export", *common(recording, data), "--format", name, "--out", out)[0] == 0
    before = {file: file.read_bytes() for file in out.iterdir()}
    words = (recording, "--camera", "right", "--data", data, "--format", name)
    code, _, err = call(capsys, "export", *words, "--out", out)
    assert code == 2 and "give each camera a folder of its own" in err
    assert before == {file: file.read_bytes() for file in out.iterdir()}
    assert call(capsys, "export", *words, "--out", tmp_path / "right")[0] == 0
    assert call(capsys, "export", *common(recording, data), "--format", name, "--out", out)[0] == 0, "the same again"


@pytest.mark.parametrize(
    "text",
    [
        "sep=;\nt_us;state;x_px;y_px\n7;visible;2,5;2\n9;no_ball;;\n",
        '"sep=,"\r\nt_us,state,x_px,y_px\r\n7,visible,2.5,2\r\n9,no_ball,,\r\n',
        "# by somebody, in May\n#\nt_us,state,x_px,y_px\n7,visible,2.5,2\n9,no_ball,,\n",
        "# by somebody\n# t_us,state,x_px,y_px\n7,visible,2.5,2\n9,no_ball,,\n",
        "t_us,state,x_px,y_px,window_start_us,window_end_us\n7,visible,2.5,2,1.0,9.0\n9.0,no_ball,,,,\n",
    ],
)
def test_tables_of_spreadsheets_and_numpy(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path, text: str
) -> None:
    table = tmp_path / "a.csv"
    table.write_bytes(text.encode())
    code, out, err = call(capsys, "import", table, *common(recording, data), "--format", "csv", "--check", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["states"] == {"visible": 1, "no_ball": 1} and not found["rejected"]
    assert found["examples"][0]["x_px"] == 2.5 and (found["first_us"], found["last_us"]) == (7, 9)


def test_a_line_that_is_rejected_below_remarks_has_its_number(
    capsys: pytest.CaptureFixture[str], recording: Path, data: Path, tmp_path: Path
) -> None:
    table = tmp_path / "a.csv"
    table.write_text("# one\n# two\nt_us,state,x_px,y_px\n7,visible,1,1\n8,visible,x,2\n")
    code, out, _ = call(capsys, "import", table, *common(recording, data), "--format", "csv", "--check")
    assert code == 0 and f"{table}:5: " in out
    times = tmp_path / "times.csv"
    times.write_text("sep=;\nframe;t_us\n0;1000\n1;2000\n")
    track = tmp_path / "track.csv"
    track.write_text("frame,x,y\n0,5,6\n1,7,8\n")
    words = ("--format", "csv", "--frame-times", times, "--check")
    assert call(capsys, "import", track, *common(recording, data), *words)[1].startswith("2 labels would be imported")
