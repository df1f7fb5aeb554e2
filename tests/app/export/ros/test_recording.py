"""What is written is read by rosbags and mcap, and by our own import event for event."""

from __future__ import annotations

from collections import defaultdict

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_types_from_msg, get_typestore
from rosbags.typesys.stores import Stores

from app.export.ros.recording import export_mcap, export_rosbag
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from core.cameras import Camera
from core.chain import ChainConfig
from core.errors import CommandError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from core.recordings.sources import open_sources
from tests.app.export.tasks import task_of

SPAN = Span(100_500, 400_000)
CHAIN = ChainConfig.of_method("refined")


@pytest.fixture(scope="module")
def recording(serve_recording):
    with open_recording(serve_recording) as opened:
        yield opened


@pytest.fixture(scope="module")
def mcap_file(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "rally.mcap"
    return export_mcap(task_of(recording, path, SPAN, chain=CHAIN, stride_us=20_000))[0]


@pytest.fixture(scope="module")
def messages(mcap_file):
    """Messages by topic, decoded with the definitions in the file, with their times."""
    found = defaultdict(list)
    store = get_typestore(Stores.EMPTY)
    with mcap_file.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        known = set()
        for schema, channel, message in reader.iter_messages():
            if schema.name not in known:
                known.add(schema.name)
                store.register(get_types_from_msg(schema.data.decode(), schema.name))
            content = store.deserialize_cdr(message.data, schema.name)
            found[channel.topic].append((message.log_time, content))
    return found


def same_events(path, recording, name):
    with open_recording(path) as back:
        again, original = back.cameras[name], recording.cameras[name]
        events, expected = again.slice(0, 1_000_000), original.slice(SPAN.start_us, SPAN.end_us)
        assert len(expected) > 10_000
        np.testing.assert_array_equal(events.t_us + again.t_offset_us, expected.t_us)
        np.testing.assert_array_equal(events.x_px, expected.x_px)
        np.testing.assert_array_equal(events.y_px, expected.y_px)
        np.testing.assert_array_equal(events.on, expected.on)
        assert again.sensor == original.sensor
        camera, truth = again.calibration, original.calibration
        assert camera is not None and truth is not None
        np.testing.assert_array_equal(camera.K, truth.K)
        np.testing.assert_array_equal(camera.distortion, truth.distortion)
        np.testing.assert_allclose(camera.T_world_camera, truth.T_world_camera, atol=1e-9)


def test_a_bag_is_read_back_event_for_event_with_its_calibration(recording, tmp_path):
    files = export_rosbag(task_of(recording, tmp_path / "rally", SPAN))
    assert [file.name for file in files] == ["metadata.yaml", "rally.db3"]
    for name in ("left", "right"):
        same_events(tmp_path / "rally", recording, name)


def test_rosbags_reads_the_bag_and_its_packets_are_those_of_event_cameras(recording, tmp_path):
    export_rosbag(task_of(recording, tmp_path / "rally", SPAN))
    with AnyReader([tmp_path / "rally"]) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections}
        assert kinds["/left/events"] == "event_camera_msgs/msg/EventPacket"
        assert set(kinds) == {"/left/events", "/right/events", "/left/camera_info", "/right/camera_info", "/tf_static"}
        packets = [
            (time, reader.deserialize(data, one.msgtype))
            for one, time, data in reader.messages()
            if one.topic == "/left/events"
        ]
    first = recording.cameras["left"].slice(SPAN.start_us, SPAN.end_us).t_us[0]
    assert packets[0][0] == 1000 * int(first)
    assert [packet.seq for _, packet in packets] == list(range(len(packets)))
    sensor = recording.cameras["left"].sensor
    assert {(one.encoding, one.width, one.height) for _, one in packets} == {
        ("evt3", sensor.width_px, sensor.height_px)
    }
    stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for _, one in packets]
    assert stamps == [time for time, _ in packets]
    words = [one.events.view("<u2") for _, one in packets]
    assert all(part[0] >> 12 == 8 for part in words[1:])  # each packet begins with its coarse time


def test_the_mcap_file_is_read_back_event_for_event(recording, mcap_file):
    for name in ("left", "right"):
        same_events(mcap_file, recording, name)


def test_the_ball_of_an_mcap_file_is_where_it_truly_is(recording, messages):
    truth = recording.ball
    measured = messages["/ball"]
    assert len(measured) > 50
    errors = []
    for _, one in measured:
        t_us = one.header.stamp.sec * 10**6 + one.header.stamp.nanosec / 1000
        place = [np.interp(t_us, truth.t_us, truth.p_world_m[:, axis]) for axis in range(3)]
        errors.append(np.linalg.norm(np.array([one.point.x, one.point.y, one.point.z]) - place))
    assert np.median(errors) < 0.01
    assert len(messages["/ball_true"]) == np.count_nonzero(
        truth.visible & (truth.t_us >= SPAN.start_us) & (truth.t_us < SPAN.end_us)
    )
    assert messages["/ball"][0][1].header.frame_id == "world"
    assert len(messages["/prediction"][-1][1].poses) > 1
    assert messages["/table"][0][1].scale.x == 2.74


@pytest.mark.parametrize("what", ["ball", "prediction"])
def test_each_ball_and_prediction_of_an_mcap_file_names_its_cameras(messages, what):
    of_each = messages[f"/{what}_cameras"]
    assert [time for time, _ in of_each] == [time for time, _ in messages[f"/{what}"]]
    assert {one.data for _, one in of_each} == {"left+right"}


def test_detections_lie_on_the_true_ball_in_the_pixels_of_foxglove(recording, messages):
    truth = recording.cameras["left"].truth
    found = messages["/left/detections"]
    assert len(found) > 50
    errors = []
    for _, one in found:
        (circle,) = one.circles
        t_us = circle.timestamp.sec * 10**6 + circle.timestamp.nanosec / 1000
        u, v = np.interp(t_us, truth.t_us, truth.u_px), np.interp(t_us, truth.t_us, truth.v_px)
        errors.append((circle.position.x - u, circle.position.y - v))
        assert circle.diameter > 0
    np.testing.assert_allclose(np.median(errors, axis=0), 0.5, atol=0.5)


def test_event_pictures_are_png_of_the_size_of_the_sensor(recording, messages):
    sensor = recording.cameras["left"].sensor
    pictures = messages["/left/event_image/compressed"]
    assert 10 <= len(pictures) <= 16
    image = cv2.imdecode(np.asarray(pictures[5][1].data), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (sensor.height_px, sensor.width_px, 3)
    assert image.std() > 0


def test_times_in_an_mcap_file_never_decrease(mcap_file):
    with mcap_file.open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]
    assert (np.diff(times) >= 0).all()


def test_pictures_triggers_the_camera_clock_and_a_long_silence_survive(tmp_path):
    sensor = SensorSize(346, 260)
    t_us = np.array([0, 7, 39_000_000, 39_000_001])
    events = Events.from_columns(t_us, [1, 2, 345, 4], [0, 259, 3, 4], [True, False, True, False], sensor)
    pictures = np.random.default_rng(2).integers(0, 256, (2, 48, 64, 3), np.uint8)
    epoch_us = 1_764_000_000_000_000
    sizes = {"camera": sensor, "rgb": SensorSize(64, 48)}
    with RecordingWriter(tmp_path / "a.h5", sizes, time_offsets_us=dict.fromkeys(sizes, epoch_us)) as writer:
        writer.append("camera", events)
        writer.write_frames("rgb", np.array([5, 20_000_000]), np.array([100, 100]), pictures)
    with open_recording(tmp_path / "a.h5") as recording:
        span = Span(0, recording.duration_us)
        (path,) = export_mcap(task_of(recording, tmp_path / "a.mcap", span, chain=CHAIN, stride_us=10_000_000))
    with open_recording(path) as back:
        (camera,) = back.cameras.values()
        again = camera.slice(0, back.duration_us)
        assert again.t_us.tolist() == t_us.tolist()
        assert again.x_px.tolist() == events.x_px.tolist()
        assert again.on.tolist() == events.on.tolist()
        assert camera.t_offset_us == epoch_us
        assert back.frames["rgb"].t_us.tolist() == [5, 20_000_000]
        np.testing.assert_array_equal(back.frames["rgb"].image(1), pictures[1])


def test_a_cancelled_export_leaves_nothing(recording, tmp_path):
    with pytest.raises(ExportCancelledError):
        export_mcap(task_of(recording, tmp_path / "a.mcap", SPAN, chain=CHAIN, cancelled=lambda: True))
    with pytest.raises(ExportCancelledError):
        export_rosbag(task_of(recording, tmp_path / "bag", SPAN, cancelled=lambda: True))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_bag_is_not_replaced_without_being_asked(recording, tmp_path):
    export_rosbag(task_of(recording, tmp_path / "rally", SPAN))
    with pytest.raises(CommandError, match="exists already"):
        export_rosbag(task_of(recording, tmp_path / "rally", SPAN))
    export_rosbag(task_of(recording, tmp_path / "rally", SPAN, overwrite=True))
    same_events(tmp_path / "rally", recording, "left")


@pytest.mark.parametrize(
    ("lens", "model", "name"),
    [
        ([-0.3, 0.1, 0.001, 0.002, 0.0], "pinhole", "plumb_bob"),
        ([0.1, 0.02, 0.001, 0.002, 0.003, 0.1, 0.02, 0.01], "pinhole", "rational_polynomial"),
        ([0.1, 0.02, 0.001, 0.002, 0.003, 0.1, 0.02, 0.01, 0, 0, 0, 0], "pinhole", "rational_polynomial"),
        ([0.05, -0.01, 0.002, -0.001], "fisheye", "equidistant"),
    ],
)
def test_a_lens_is_written_by_the_name_that_ros_has_and_read_back(tmp_path, lens, model, name):
    sensor = SensorSize(64, 48)
    K = np.array([[60.0, 0, 31], [0, 60, 23], [0, 0, 1]])
    camera = Camera(sensor, K, np.array(lens), np.eye(4), model)
    events = Events(np.array([0, 5]), np.array([1, 2]), np.array([3, 4]), np.array([True, False]), sensor)
    with RecordingWriter(tmp_path / "a.h5", {"eye": sensor}, calibration={"eye": camera}) as writer:
        writer.append("eye", events)
    with open_recording(tmp_path / "a.h5") as recording:
        export_rosbag(task_of(recording, tmp_path / "bag", Span(0, 10)))
    with AnyReader([tmp_path / "bag"]) as reader:
        (info,) = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if "camera_info" in c.topic]
    assert info.distortion_model == name and info.d.tolist() == lens[:8]
    (source,) = open_sources(tmp_path / "bag")
    assert source.calibration is not None and source.calibration.model == model
    assert source.calibration.distortion.tolist() == lens[:8]


def test_a_lens_that_ros_has_no_name_for_is_refused(tmp_path):
    sensor = SensorSize(64, 48)
    lens = np.array([0.1, 0.02, 0.001, 0.002, 0.003, 0.1, 0.02, 0.01, 0.001, 0, 0, 0])
    camera = Camera(sensor, np.array([[60.0, 0, 31], [0, 60, 23], [0, 0, 1]]), lens, np.eye(4))
    with RecordingWriter(tmp_path / "a.h5", {"eye": sensor}, calibration={"eye": camera}) as writer:
        writer.append("eye", Events(np.array([0]), np.array([1]), np.array([3]), np.array([True]), sensor))
    refused = pytest.raises(CommandError, match="ROS has no name for a lens")
    with open_recording(tmp_path / "a.h5") as recording, refused:
        export_rosbag(task_of(recording, tmp_path / "bag", Span(0, 10)))
    assert not (tmp_path / "bag").exists()
