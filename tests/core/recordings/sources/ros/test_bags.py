"""Bags of ROS 1, ROS 2 and MCAP files become recordings with the values that were written."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from tests.core.recordings.sources.ros.bag_writing import (
    EPOCH_S,
    BagMaker,
    evt3_words,
    libcaer_words,
    mono_words,
    store_of,
)

T0 = EPOCH_S * 1_000_000
EVENTS = [
    (T0 + 5, 0, 259, True),
    (T0 + 5, 345, 0, False),
    (T0 + 1_000_007, 3, 7, False),
    (T0 + 1_000_008, 100, 50, True),
    (T0 + 1_200_000, 12, 13, True),
]
KINDS = ("ros1", "ros2", "mcap")


def bag_at(tmp_path, kind):
    return tmp_path / ("a.bag" if kind == "ros1" else "a_bag")


def rows_of(source):
    report = DecodeReport()
    events = concatenate_events(list(source.read(report)), source.sensor)
    columns = (events.t_us, events.x_px, events.y_px, events.on)
    return list(zip(*(column.tolist() for column in columns), strict=True)), report.notes


@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs"])
@pytest.mark.parametrize("kind", KINDS)
def test_arrays_of_events_are_read_from_every_kind_of_bag(tmp_path, kind, package):
    path = bag_at(tmp_path, kind)
    with BagMaker(path, kind) as bag:
        for part in (EVENTS[:1], EVENTS[1:3], EVENTS[3:], []):
            bag.add_events("/dvs/events", part, package=package)
    (source,) = open_sources(path)
    assert (source.name, str(source.sensor)) == ("camera", "346x260")
    assert source.format == ("ROS 1 bag" if kind == "ros1" else "ROS 2 bag") + " (EventArray)"
    assert rows_of(source) == (EVENTS, [])


def test_the_start_of_a_bag_is_time_0_and_its_clock_is_kept(tmp_path):
    with BagMaker(tmp_path / "a.bag", "ros1") as bag:
        bag.add_events("/dvs/events", EVENTS)
    import_recording(ImportOrder([tmp_path / "a.bag"]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        (camera,) = recording.cameras.values()
        assert camera.slice(0, 2_000_000).t_us.tolist() == [0, 0, 1_000_002, 1_000_003, 1_199_995]
        assert camera.t_offset_us == T0 + 5
        assert recording.duration_us == 1_199_996


def test_a_bag_is_known_by_its_content_whatever_its_name(tmp_path):
    for kind, inner in (("ros1", "a.bag"), ("ros2", "a_bag/a_bag.db3"), ("mcap", "a_bag/a_bag.mcap")):
        folder = tmp_path / kind
        folder.mkdir()
        with BagMaker(folder / inner.split("/")[0], kind) as bag:
            bag.add_events("/dvs/events", EVENTS)
        nameless = tmp_path / f"nameless_{kind}"
        nameless.write_bytes((folder / inner).read_bytes())
        assert rows_of(open_sources(nameless)[0])[0] == EVENTS


@pytest.mark.parametrize("encoding", ["evt3", "mono", "libcaer"])
@pytest.mark.parametrize("kind", KINDS)
def test_packets_of_every_encoding_are_read(tmp_path, kind, encoding):
    events = [(t, x, y, on) for t, x, y, on in EVENTS]
    path = bag_at(tmp_path, kind)
    camera_start = T0 - 40_000_000  # on the clock of a camera that runs for 40 s
    with BagMaker(path, kind) as bag:
        for number, part in enumerate((events[:3], events[3:])):
            stamp = part[0][0] * 1000
            if encoding == "evt3":
                data = evt3_words([(t - camera_start, x, y, on) for t, x, y, on in part])
                bag.add_packet("/event_camera/events", data, encoding, stamp, seq=number)
            elif encoding == "mono":
                base = part[0][0] - camera_start
                data = mono_words([(t - camera_start, x, y, on) for t, x, y, on in part], base)
                bag.add_packet("/event_camera/events", data, encoding, stamp, seq=number, time_base=base * 1000)
            else:
                data = libcaer_words(part, part[0][0] - 3)
                base = (part[0][0] - 3) * 1000
                bag.add_packet("/event_camera/events", data, encoding, stamp, seq=number, time_base=base)
    (source,) = open_sources(path)
    assert str(source.sensor) == "640x480"
    assert source.format.endswith(f"(EventPacket, {encoding})")
    assert rows_of(source) == (EVENTS, [])


def test_lost_packets_and_an_unknown_encoding_are_told(tmp_path):
    with BagMaker(tmp_path / "a.bag", "ros1") as bag:
        bag.add_packet("/left/events", evt3_words([(5000, 1, 2, True)]), "evt3", T0 * 1000, seq=7)
        bag.add_packet("/left/events", evt3_words([(6000, 3, 4, True)]), "evt3", T0 * 1000 + 10**6, seq=10)
        bag.add_packet("/right/events", b"12345678", "hevt", T0 * 1000)
    (source,) = open_sources(tmp_path / "a.bag")
    rows, notes = rows_of(source)
    assert rows == [(T0, 1, 2, True), (T0 + 1000, 3, 4, True)]
    assert notes[0] == "/right/events is left out: encoding 'hevt' is not read, only evt2, evt21, evt3, mono, libcaer."
    assert notes[1] == "/left/events: 2 packets are missing by their numbers."


def test_cameras_whose_clocks_agree_are_on_one_clock_and_others_are_aligned_by_their_headers(tmp_path):
    for late_us, expected, said in ((3_000, 500, "taken for one clock"), (700_000, 700_500, "clocks of their own")):
        path = tmp_path / f"{late_us}.bag"
        with BagMaker(path, "ros1") as bag:
            bag.add_packet("/cam_left/events", evt3_words([(9000, 1, 2, True)]), "evt3", T0 * 1000)
            stamp = (T0 + 500 + late_us) * 1000
            bag.add_packet("/cam_right/events", evt3_words([(9500, 3, 4, True)]), "evt3", stamp)
        left, right = open_sources(path)
        assert (left.name, right.name) == ("cam_left", "cam_right")
        (rows, notes), (others, _) = rows_of(left), rows_of(right)
        assert said in notes[0]
        assert others[0][0] - rows[0][0] == expected


def test_a_topic_without_events_is_told_and_a_bag_without_any_refused(tmp_path):
    with BagMaker(tmp_path / "a.bag", "ros1") as bag:
        bag.add_events("/dvs/left/events", EVENTS)
        bag.add_events("/dvs/right/events", [])
    (source,) = open_sources(tmp_path / "a.bag")
    assert rows_of(source)[1] == ["/dvs/right/events is left out: it has no events."]
    with BagMaker(tmp_path / "b.bag", "ros1") as bag:
        bag.add_info("/dvs/camera_info", "cam", np.eye(3), [])
    with pytest.raises(RecordingError, match=r"no events in the bag; expected a topic of .* got /dvs/camera_info"):
        open_sources(tmp_path / "b.bag")


K_LEFT = np.array([[300.0, 0, 170], [0, 301.0, 131], [0, 0, 1]])
K_RIGHT = np.array([[310.0, 0, 171], [0, 311.0, 132], [0, 0, 1]])


def write_stereo(path, kind, *, transforms=False, rectified=False, model="plumb_bob"):
    P = np.zeros((3, 4))
    P[0, 0], P[0, 3] = 250, -250 * 0.1
    with BagMaker(path, kind) as bag:
        bag.add_events("/davis/left/events", EVENTS, frame_id="left_optical")
        bag.add_events("/davis/right/events", EVENTS, frame_id="right_optical")
        D = [-0.3, 0.1, 0.001, 0.002, 0.0]
        bag.add_info("/davis/left/camera_info", "left_optical", K_LEFT, D, model=model)
        bag.add_info("/davis/right/camera_info", "right_optical", K_RIGHT, D, P=P if rectified else None, model=model)
        if transforms:
            bag.add_static_transform("world", "rig", (0, 0, 2), (0, 0, 0, 1))
            bag.add_static_transform("rig", "left_optical", (0.5, 0, 0), (1, 0, 0, 0))
            bag.add_static_transform("rig", "right_optical", (-0.5, 0, 0), (0, 0, 0, 1))


@pytest.mark.parametrize("kind", KINDS)
def test_lenses_come_from_camera_info_and_poses_from_the_static_transforms(tmp_path, kind):
    path = bag_at(tmp_path, kind)
    write_stereo(path, kind, transforms=True)
    import_recording(ImportOrder([path]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        left, right = (recording.cameras[name].calibration for name in ("left", "right"))
        assert left is not None and right is not None
        assert left.K.tolist() == K_LEFT.tolist()
        assert right.K.tolist() == K_RIGHT.tolist()
        assert left.distortion.tolist() == [-0.3, 0.1, 0.001, 0.002, 0]
        assert left.position_world_m.tolist() == [0.5, 0, 2]
        np.testing.assert_allclose(left.T_world_camera[:3, :3], np.diag([1, -1, -1]), atol=1e-12)
        assert right.position_world_m.tolist() == [-0.5, 0, 2]


def test_a_rectified_pair_tells_the_pose_of_its_right_camera(tmp_path):
    write_stereo(tmp_path / "a.bag", "ros1", rectified=True)
    left, right = open_sources(tmp_path / "a.bag")
    assert left.calibration.position_world_m.tolist() == [0, 0, 0]
    np.testing.assert_allclose(right.calibration.position_world_m, [0.1, 0, 0])
    assert "those of their rectification" in rows_of(left)[1][0]


def test_cameras_whose_place_is_not_told_stay_uncalibrated_and_it_is_said(tmp_path):
    write_stereo(tmp_path / "a.bag", "ros1")
    left, right = open_sources(tmp_path / "a.bag")
    assert left.calibration is None and right.calibration is None
    assert "does not tell where the cameras stand; --calibration gives it" in rows_of(left)[1][0]


def test_a_lens_model_that_is_not_read_is_named(tmp_path):
    write_stereo(tmp_path / "a.bag", "ros1", transforms=True, model="omnidirectional")
    left, _ = open_sources(tmp_path / "a.bag")
    assert left.calibration is None
    note = rows_of(left)[1][0]
    assert "The calibration of /davis/left/camera_info is left out" in note and "got omnidirectional" in note


def test_a_fisheye_lens_of_a_bag_is_read(tmp_path):
    write_stereo(tmp_path / "a.bag", "ros1", transforms=True, model="equidistant")
    left, _ = open_sources(tmp_path / "a.bag")
    assert left.calibration is not None and left.calibration.model == "fisheye"
    assert len(left.calibration.distortion) == 4


@pytest.mark.parametrize("kind", KINDS)
def test_pictures_of_the_event_camera_and_of_another_come_along(tmp_path, kind):
    rng = np.random.default_rng(3)
    grey = rng.integers(0, 256, (2, 260, 346), np.uint8)
    colour = rng.integers(0, 256, (48, 64, 3), np.uint8)
    path = bag_at(tmp_path, kind)
    with BagMaker(path, kind) as bag:
        bag.add_events("/dvs/events", EVENTS)
        for number, image in enumerate(grey):
            bag.add_image("/dvs/image_raw", image, "mono8", T0 + 100_000 * (number + 1), pad=6)
        bag.add_image("/rgb/image_raw", colour, "bgr8", T0 + 150_000)
        bag.add_image("/dvs_rendering", grey[0], "mono8", T0)
        png = np.frombuffer(cv2.imencode(".png", colour)[1].tobytes(), np.uint8)
        header = bag.header((T0 + 160_000) * 1000)
        message = bag.make("sensor_msgs/msg/CompressedImage", header=header, format="png", data=png)
        bag.add("/side/image_raw/compressed", message, (T0 + 160_000) * 1000)
    import_recording(ImportOrder([path]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        assert list(recording.cameras) == ["camera"]
        assert set(recording.frames) == {"camera", "rgb", "side"}
        own = recording.frames["camera"]
        assert own.t_us.tolist() == [99_995, 199_995]
        np.testing.assert_array_equal(own.image(1), grey[1])
        np.testing.assert_array_equal(recording.frames["rgb"].image(0), colour[:, :, ::-1])
        np.testing.assert_array_equal(recording.frames["side"].image(0), colour[:, :, ::-1])
        assert any("/dvs_rendering is left out" in note for note in recording.notes)


def test_an_mcap_file_of_ros_1_messages_and_one_that_was_cut_short(tmp_path):
    from mcap.writer import Writer

    store = store_of(ros1=True)
    path = tmp_path / "a.mcap"
    maker = BagMaker(tmp_path / "unused.bag", "ros1")
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300)
        writer.start("ros1")
        definition = store.generate_msgdef("dvs_msgs/msg/EventArray", ros_version=1)[0]
        schema = writer.register_schema("dvs_msgs/EventArray", "ros1msg", definition.encode())
        channel = writer.register_channel("/dvs/events", "ros1", schema)

        class Sink:
            def add_connection(self, *_, **__):
                return None

            def write(self, _, time_ns, data):
                writer.add_message(channel, log_time=time_ns, publish_time=time_ns, data=data)

        maker.writer = Sink()
        for number in range(40):
            maker.add_events("/dvs/events", [(T0 + 1000 * number, number, 7, True)])
        writer.finish()
    rows, notes = rows_of(open_sources(path)[0])
    assert rows == [(T0 + 1000 * number, number, 7, True) for number in range(40)]
    assert notes == []
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    kept, notes = rows_of(open_sources(path)[0])
    assert 5 < len(kept) < 40
    assert kept == rows[: len(kept)]
    assert notes == ["a.mcap: the file was cut short; what is whole was read."]


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
@pytest.mark.parametrize("share", [0.6, 0.8, 0.98])
def test_a_bag_without_its_index_keeps_what_is_whole(tmp_path, kind, share):
    path = bag_at(tmp_path, kind)
    rows = [(T0 + 1000 * number, number % 346, 7, True) for number in range(400)]
    with BagMaker(path, kind) as bag:
        for row in rows:
            bag.add_events("/dvs/events", [row])
    file = path if kind == "ros1" else next(path.glob("*.db3"))
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    kept, notes = rows_of(open_sources(file)[0])
    assert 20 < len(kept) <= len(rows)
    assert kept == [row for row in rows if row in kept]  # the page in which SQLite's file was cut has no rows
    assert notes == [f"{file.name}: the file was cut short; what is whole was read."]


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_give_their_good_part_or_one_clear_line(tmp_path, kind):
    rng = np.random.default_rng(9)
    path = bag_at(tmp_path, kind)
    with BagMaker(path, kind) as bag:
        for number in range(60):
            bag.add_events("/dvs/events", [(T0 + 1000 * number + i, i, number, True) for i in range(20)])
    file = path if kind == "ros1" else next(item for item in path.iterdir() if item.suffix in (".db3", ".mcap"))
    data = file.read_bytes()
    for case in range(12):
        at = int(rng.integers(20, len(data) - 64))
        file.write_bytes(data[:at] if case % 2 else data[:at] + rng.bytes(48) + data[at + 48 :])
        try:
            (source,) = open_sources(path)
            rows, _ = rows_of(source)
        except RecordingError:
            continue
        assert len(rows) <= 1200
        assert (np.diff([row[0] for row in rows]) >= 0).all()


def test_the_size_of_the_sensor_can_be_given(tmp_path):
    with BagMaker(tmp_path / "a.bag", "ros1") as bag:
        bag.add_events("/dvs/events", EVENTS, size=(0, 0))
    with pytest.raises(RecordingError, match="do not name the size of the sensor; give --width and --height"):
        open_sources(tmp_path / "a.bag")
    (source,) = open_sources(tmp_path / "a.bag", SensorSize(346, 260))
    assert rows_of(source)[0] == EVENTS
