"""The Rerun file, judged by Rerun's own command line; its warnings are errors here."""

import csv
import io
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from PIL import Image
from rerun.error_utils import strict_mode

from app.cli import main
from app.export.rrd.camera import EventStage, PictureJob, make_picture
from app.export.rrd.recording import RrdContents, blueprint_of, export_rrd
from app.export.selection import Span, polarity_png, span_of
from app.export.steps import ChainFollower
from app.export.unfinished import ExportCancelledError
from app.pictures.palette import palette
from core.cameras.presets import camera_preset
from core.chain import ChainConfig
from core.detection import DetectorConfig
from core.errors import CommandError
from core.events import Events
from core.recordings import RecordingWriter, open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.app.export.tasks import task_of
from tests.waiting import PATIENCE_S

SPAN = Span(100_000, 260_000)


@pytest.fixture(autouse=True)
def _strict():
    before = strict_mode()
    rr.set_strict_mode(True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield
    rr.set_strict_mode(before)


def rerun(*words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", *words], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert not any(word in done.stderr for word in ("WARN", "ERROR", "error:")), done.stderr  # 0.26 exits with 0
    return done.stdout + done.stderr


def entities(path: Path) -> set[str]:
    section = rerun("stats", str(path)).partition("Num chunks per entity")[2]
    return {line.partition(":")[0].strip("/") for line in section.splitlines() if line.startswith("/")}


def contents_of(path: Path, entity: str) -> str:
    """All that the file has of an entity, as Rerun prints it."""
    chunks = rerun("print", "-vvv", str(path)).split("\nChunk(")
    return "\n".join(chunk for chunk in chunks if f" - /{entity} - " in chunk.partition("\n")[0])


@pytest.fixture(scope="module")
def exported(serve_recording: Path, tmp_path_factory) -> Path:
    with open_recording(serve_recording) as recording:
        path = tmp_path_factory.mktemp("rrd") / "serve.rrd"
        shares: list[float] = []
        chain = ChainConfig.of_method("auto")  # it has stages
        export_rrd(task_of(recording, path, SPAN, chain=chain, progress=shares.append))
        assert shares[-1] == 1.0 and shares == sorted(shares)
        return path


def test_rerun_finds_nothing_wrong_with_the_file(exported: Path) -> None:
    assert "verified without error" in rerun("verify", str(exported))
    assert [path.name for path in exported.parent.iterdir()] == ["serve.rrd"], "nothing else is left"


def test_everything_that_was_seen_is_in_the_file(exported: Path) -> None:
    found = entities(exported)
    rally = {"ball/truth", "ball/triangulated", "ball/trail", "prediction/flight", "prediction/hit"}
    still = {"table", "table/lines", "net", "hitting_plane"}
    camera = {"", "/stages/events", "/stages/hulls", "/stages/roi", "/detection", "/truth"}
    pictures = {f"cameras/{name}/picture{layer}" for name in ("left", "right") for layer in camera}
    assert {f"world/{name}" for name in rally | still | pictures} <= found
    plots = {"event_rate/left", "latency/detect", "latency/predict", "error_px/right", "error_px/residual"}
    assert {f"plots/{name}" for name in plots | {"error_mm/ball"}} <= found
    assert "recording_time" in rerun("print", "-vv", str(exported))


@pytest.mark.gate
def test_the_command_line_shows_racket_episodes_predictions_and_labels(serve_recording, tmp_path, capsys) -> None:
    source = _recording_of_a_rally(serve_recording, tmp_path / "rally.h5")
    data = ["--data", str(tmp_path / "data")]
    with open_recording(source) as recording:
        uuid = recording.uuid
    with LabelStore.open(tmp_path / "data" / "labels", uuid, "left", "Anna") as store:
        store.put(Label(t_us=20_000, state=LabelState.VISIBLE, x_px=300.0, y_px=200.0, r_px=9.0))
    out = tmp_path / "rally.rrd"
    words = ["export", str(source), "--rrd", str(out), "--end-us", "60000", "--stride-us", "10000", "--json"]
    assert main([*words, "--annotator", "Anna", *data]) == 0, capsys.readouterr().err
    found = entities(out)
    assert {f"world/{name}" for name in ("racket", "racket/blade", "racket_target", "target", "landings")} <= found
    assert {"plots/reward", "world/prediction/recorded_hit", "world/cameras/left/picture/label"} <= found
    assert "world/prediction/hit_places" in found
    assert "left, right" in contents_of(out, "world/prediction/recorded_hit")
    assert main(["export", str(source), "--csv", str(tmp_path / "tables"), "--end-us", "30000"]) == 0
    with (tmp_path / "tables" / "hit_choices.csv").open(newline="") as file:
        places = list(csv.DictReader(file))
    assert [(one["chosen"], one["chance"], one["why_not"]) for one in places] == [
        ("1", "0.97", ""),
        ("0", "0", "too low"),
    ]
    assert main(words) == 2 and "exists already" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    assert "world/cameras/left/picture/label" not in entities(out)
    with LabelStore.open(tmp_path / "data" / "labels", uuid, "left", "Anna") as store:
        store.undo()
    assert main([*words, "--force", "--annotator", "Anna", *data]) == 0, "a name under which nothing is labelled"
    assert "world/cameras/left/picture/label" not in entities(out)


def test_of_four_cameras_ball_and_flight_name_those_that_they_are_made_from(four_recording, tmp_path) -> None:
    with open_recording(four_recording) as recording:
        task = task_of(recording, tmp_path / "four.rrd", Span(100_000, 160_000), pictures=False, plots=False)
        export_rrd(task)
    for entity in ("world/ball/triangulated", "world/prediction/flight"):
        assert "near_left, near_right" in contents_of(task.path, entity), entity


def test_a_single_camera_without_calibration_has_pictures_and_detections_only(serve_recording, tmp_path) -> None:
    source = tmp_path / "one.h5"
    with open_recording(serve_recording) as recording:
        left = recording.cameras["left"]
        with RecordingWriter(source, {"eye": left.sensor}) as writer:
            writer.append("eye", left.slice(0, 200_000))
    assert main(["export", str(source), "--method", "auto", "--rrd", str(tmp_path / "one.rrd")]) == 0
    found = entities(tmp_path / "one.rrd")
    assert {"pictures/eye", "pictures/eye/detection", "pictures/eye/stages/events", "plots/event_rate/eye"} <= found
    assert not any(name.startswith("world") for name in found)
    assert "verified without error" in rerun("verify", str(tmp_path / "one.rrd"))


def test_pictures_of_a_frame_camera_stand_beside_those_of_the_event_cameras(tmp_path, capsys) -> None:
    rig = {name: camera for name, camera in camera_preset("corners").items() if name != "far_right"}
    pictures = np.zeros((3, 72, 128, 3), np.uint8)
    with RecordingWriter(tmp_path / "rig.h5", {name: one.sensor for name, one in rig.items()}, calibration=rig) as to:
        for name in ("near_left", "near_right"):
            to.append(name, Events.from_columns([1000], [3], [2], [True], rig[name].sensor))
        to.write_frames("far_left", np.array([5_000, 20_000, 35_000]), np.full(3, 4_000), pictures)
        to.extend_duration(60_000)
    path = tmp_path / "rig.rrd"
    with open_recording(tmp_path / "rig.h5") as recording:
        export_rrd(task_of(recording, path, Span(10_000, 60_000), stride_us=10_000))
        blueprint = blueprint_of(recording, RrdContents(), recording.read_rows)
        _, views = blueprint.root_container.contents[0].contents
        assert [one.name for one in views.contents] == ["near_left", "near_right", "far_left"]
        export_rrd(task_of(recording, tmp_path / "plain.rrd", Span(10_000, 60_000), pictures=False))
    place = "world/cameras/far_left/picture"
    assert "verified without error" in rerun("verify", str(path))
    assert place in entities(path) and place not in entities(tmp_path / "plain.rrd")
    chunks = [one for one in rerun("print", "-vvv", str(path)).split("Chunk(") if f"- /{place} -" in one]
    shown = [any(when in one for one in chunks) for when in ("PT0.005S", "PT0.02S", "PT0.035S")]
    assert shown == [False, True, True], "the first is before the part"


def test_a_method_without_stages_has_pictures_and_detections_but_no_stages(serve_recording, tmp_path) -> None:
    single = tmp_path / "one.h5"
    with open_recording(serve_recording) as recording:
        left = recording.cameras["left"]
        with RecordingWriter(single, {"eye": left.sensor}) as writer:
            writer.append("eye", left.slice(0, 150_000))
    words = ["--end-us", "150000"]  # with the default method
    for source, picture in ((serve_recording, "world/cameras/left/picture"), (single, "pictures/eye")):
        out = tmp_path / f"{source.stem}.rrd"
        assert main(["export", str(source), "--rrd", str(out), *words]) == 0
        found = entities(out)
        assert {picture, f"{picture}/detection"} <= found and f"{picture}/stages/events" not in found
        assert "verified without error" in rerun("verify", str(out))


def test_a_cancelled_export_leaves_no_file(serve_recording: Path, tmp_path) -> None:
    asked = iter([False] * 20 + [True] * 1000)
    with open_recording(serve_recording) as recording, pytest.raises(ExportCancelledError):
        export_rrd(task_of(recording, tmp_path / "a.rrd", SPAN, cancelled=lambda: next(asked)))
    assert list(tmp_path.iterdir()) == []


def test_a_part_that_does_not_exist_is_refused(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        assert span_of(recording) == Span(0, recording.duration_us)
        assert span_of(recording, 5, 10**9) == Span(5, recording.duration_us)
        for start, end in ((-1, 5), (7, 7), (recording.duration_us, None)):
            with pytest.raises(CommandError, match="no such part"):
                span_of(recording, start, end)


@pytest.mark.parametrize("shape", [(3, 4), (5, 7), (2, 9), (720, 1280)])
def test_a_small_png_is_the_picture(shape) -> None:
    picture = np.random.default_rng(3).integers(0, 3, shape).astype(np.uint8)
    image = Image.open(io.BytesIO(polarity_png(picture)))
    assert np.array_equal(np.asarray(image.convert("RGB")), palette("orange / blue")[picture])


def test_the_stages_of_a_picture_are_those_that_the_chain_ran(serve_recording: Path) -> None:
    detections = 0
    with open_recording(serve_recording) as recording:
        follower = ChainFollower(recording, ChainConfig.of_method("auto"), picture_every=1)
        for step in follower.follow(recording, SPAN):
            assert step.before is not None
            found = step.detections["left"]
            picture = make_picture(PictureJob(step.windows["left"], step.before["left"], DetectorConfig(), True))
            assert picture.t_us == step.end_us and len(picture.event_stages) == len(picture.events_px)
            edge = picture.events_px[picture.event_stages == EventStage.LEADING]
            if found is not None and len(edge):
                detections += 1
                reach = np.hypot(*(edge - (found.u_px, found.v_px)).T)
                assert reach.max() < 1.05 * found.r_px + 0.1, "the circle goes round the leading edge"
    assert detections > 40


def _recording_of_a_rally(serve: Path, path: Path) -> Path:
    rows = {"t_us": np.arange(0, 100_000, 2000)}
    n = len(rows["t_us"])
    with open_recording(serve) as recording:
        streams = recording.cameras
        sensors = {name: one.sensor for name, one in streams.items()}
        calibration = {name: one.calibration for name, one in streams.items() if one.calibration is not None}
        with RecordingWriter(path, sensors, calibration=calibration) as writer:
            for name, stream in streams.items():
                writer.append(name, stream.slice(0, 100_000))
            writer.append_rows("/racket", {
                **rows, "p_world_m": np.tile([-1.4, 0.0, 0.2], (n, 1)),
                "q_world_wxyz": np.tile([1.0, 0, 0, 0], (n, 1)), "v_world_mps": np.zeros((n, 3)),
            })  # fmt: skip
            writer.append_rows("/racket_targets", {
                "t_us": np.array([15_000]), "p_world_m": np.array([[-1.42, 0, 0.2]]),
                "q_world_wxyz": np.array([[1.0, 0, 0, 0]]), "g": np.array([[0.7, 0.1]]), "stage": np.array([b"post"]),
                "t_hit_us": np.array([400_000]), "v_world_mps": np.zeros((1, 3)), "a": np.zeros((1, 3)),
            })  # fmt: skip
            writer.append_rows("/predictions", {
                "t_us": np.array([10_000, 20_000]), "stage": np.array([b"pre", b"post"]),
                "t_hit_us": np.array([400_000, 410_000]), "p_hit_m": np.array([[-1.42, 0, 0.2], [np.nan] * 3]),
                "v_hit_mps": np.zeros((2, 3)), "cov": np.tile(np.eye(6) * 1e-4, (2, 1, 1)),
                "cameras": np.array([b"left+right", b"right"]),
            })  # fmt: skip
            writer.append_rows("/hit_choices", {
                "t_us": np.array([10_000, 10_000, 40_000]), "t_hit_us": np.array([350_000, 400_000, 400_000]),
                "p_hit_m": np.array([[-1.2, 0, 0.2], [-1.42, 0, 0.0], [-1.42, 0, 0.0]]), "sigma_m": np.zeros((3, 3)),
                "chance": np.array([0.97, 0.0, 0.0]), "landing_sigma_m": np.array([0.1, np.inf, np.inf]),
                "chosen": np.array([True, False, False]), "why_not": np.array([b"", b"too low", b"too low"], "S64"),
            })  # fmt: skip
            writer.append_rows("/episodes", {
                "serve_us": np.array([0, 50_000]), "speed_mps": np.array([5.0, 5.0]), "s": np.zeros((2, 6)),
                "g": np.array([[0.7, 0.1], [np.nan, np.nan]]), "a": np.zeros((2, 3)),
                "q_wxyz": np.tile([1.0, 0, 0, 0], (2, 1)), "case": np.array([4, 5]),
                "f": np.array([[0.8, 0.0, 0.02], [np.nan] * 3]), "s_next": np.zeros((2, 6)),
                "reward": np.zeros(2), "policy": np.array([b"live"] * 2),
            })  # fmt: skip
    return path
