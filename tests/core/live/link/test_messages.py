"""Messages survive the wire, and nothing that arrives can do more than raise one clear error."""

from __future__ import annotations

import dataclasses

import msgpack
import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import SensorSize
from core.live.link import messages as m
from core.physics.config import PhysicsConfig, physics_profile
from core.physics.episode import Case

ALL = m.KINDS | m.COMMANDS


def state(**changes: object) -> m.WorldState:
    t_us = np.array([0, 500, 1000])
    values = {
        "session": "s",
        "seq": 3,
        "wall_ns": 5,
        "start_us": 0,
        "t_us": 10_000,
        "phase": "serve",
        "paused": False,
        "speed_factor": 1.0,
        "noise_hz": 0.1,
        "auto_serve_mps": 0.0,
        "real_time_factor": 2.0,
        "served": 1,
        "returned": 0,
        "ball_t_us": t_us,
        "ball": np.arange(27.0).reshape(3, 9),
        "ball_visible": np.array([1, 1, 0], np.uint8),
        "racket_t_us": t_us[:2],
        "racket": np.ones((2, 10)),
    }
    return m.WorldState(**{**values, **changes})


def batch(**changes: object) -> m.EventBatch:
    values = {
        "session": "s",
        "seq": 4,
        "wall_ns": 5,
        "camera": "left",
        "start_us": 10_000,
        "end_us": 20_000,
        "width_px": 64,
        "height_px": 48,
        "since_us": np.array([0, 7, 9999], np.uint32),
        "x_px": np.array([0, 5, 63], np.uint16),
        "y_px": np.array([0, 9, 47], np.uint16),
        "on": np.array([1, 0, 1], np.uint8),
        "truth_t_us": np.array([10_000]),
        "circle": np.array([[1.0, 2.0, 3.0]]),
    }
    return m.EventBatch(**{**values, **changes})


def welcome(physics: PhysicsConfig) -> m.Reply:
    return m.Reply(id=1, ok=True, session="s", t_us=0, block_us=10_000, seed=1, physics=physics)


UNKNOWN = m.CameraInfo.uncalibrated("new", SensorSize(320, 240))


def examples() -> list[object]:
    cameras = tuple(m.CameraInfo.of(name, camera) for name, camera in stereo_preset().items())
    nan = float("nan")
    return [
        state(),
        batch(),
        m.ServeNotice(session="s", seq=1, t_us=5, speed_mps=5.0, p_m=(1, 2, 3), v_mps=(4, 5, 6), spin_radps=(0, 0, 0)),
        m.BounceNotice(session="s", seq=2, t_us=5, p_m=(-0.8, 0, 0.02), v_mps=(-4, 0, 2)),
        m.HitNotice(
            session="s", seq=3, t_us=6, p_m=(0, 0, 0), v_mps=(5, 0, 1), v_before_mps=(-4, 0, 1), q_wxyz=(1, 0, 0, 0)
        ),
        m.OutcomeNotice(
            session="s",
            seq=1,
            t_us=5,
            serve_us=1,
            speed_mps=5.0,
            case=Case.MISSED,
            arrival=(nan,) * 6,
            q_wxyz=(1, 0, 0, 0),
            landing_m=(nan,) * 3,
            landing_v_mps=(nan,) * 3,
            net_z_m=nan,
        ),
        m.Reply(id=1, ok=True, session="s", t_us=0, block_us=10_000, seed=1, cameras=cameras),
        m.Reply(id=0, ok=True, session="s", t_us=0, block_us=10_000, cameras=(*cameras, UNKNOWN)),
        welcome(physics_profile("real")),
        m.Hello(id=1),
        m.Serve(id=2, speed_mps=6.5),
        m.Serve(id=2, p_m=(1, 0, 0.3), v_mps=(-5, 0, 1), spin_radps=(0, 10, 0)),
        m.AimRacket(id=3, p_m=(-1.4, 0, 0.2), q_wxyz=(1, 0, 0, 0), v_mps=(1, 0, 0), t_us=500),
        m.RestRacket(id=1),
        m.Pause(id=1),
        m.Resume(id=1),
        m.SingleStep(id=1, blocks=3),
        m.SetSpeed(id=1, factor=0.1),
        m.SetNoise(id=1, noise_hz=1.0),
        m.AutoServe(id=1, speed_mps=4.0),
        m.Reset(id=1),
        m.Reset(id=1, seed=9),
    ]


@pytest.mark.parametrize("message", examples(), ids=lambda message: type(message).__name__)
def test_every_message_comes_back_as_it_was_sent(message):
    found = m.decode(m.encode(message), ALL)
    assert type(found) is type(message)
    for item in dataclasses.fields(message):
        before, after = getattr(message, item.name), getattr(found, item.name)
        if item.name in ("cameras", "physics"):
            assert before == after
        else:
            np.testing.assert_array_equal(before, after)


def test_what_came_of_a_ball_travels_as_its_number() -> None:
    (notice,) = (message for message in examples() if isinstance(message, m.OutcomeNotice))
    fields = msgpack.unpackb(m.encode(notice))
    assert fields["case"] == 5
    for case in Case:
        found = m.decode(msgpack.packb(fields | {"case": case.value}), ALL)
        assert found.case is case
    for wrong in (0, 6, True, 4.0, "RETURNED", None):
        with pytest.raises(LinkError, match="case"):
            m.decode(msgpack.packb(fields | {"case": wrong}), ALL)


def test_a_camera_and_its_events_are_rebuilt():
    camera = stereo_preset()["left"]
    again = m.CameraInfo.of("left", camera).camera()
    np.testing.assert_array_equal(again.T_world_camera, camera.T_world_camera)
    events = m.decode(m.encode(batch()), ALL).events()
    assert events.t_us.tolist() == [10_000, 10_007, 19_999]
    assert events.on.tolist() == [True, False, True]


def test_only_cameras_whose_calibration_is_known_are_calibrated() -> None:
    known = m.CameraInfo.of("left", stereo_preset()["left"])
    half = dataclasses.replace(known, name="half", T_world_camera=None)
    reply = m.Reply(id=0, ok=True, session="s", t_us=0, block_us=10_000, cameras=(known, UNKNOWN, half))
    assert list(reply.calibrated()) == ["left"]
    assert UNKNOWN.camera() is None and UNKNOWN.sensor == SensorSize(320, 240)


def test_the_truth_may_be_missing_and_a_sign_of_life_ends_no_block() -> None:
    none = np.empty(0, np.int64)
    blind = dataclasses.replace(state(), ball_t_us=none, ball=np.empty((0, 9)), ball_visible=np.empty(0, np.uint8))
    assert blind.truth() is None and blind.ends_block and state().truth() is not None
    assert not dataclasses.replace(blind, start_us=blind.t_us).ends_block
    assert batch().truth() is not None
    assert dataclasses.replace(batch(), truth_t_us=none, circle=np.empty((0, 3))).truth() is None


def test_the_physics_is_whole_and_within_bounds_or_refused_and_may_grow() -> None:
    fields = msgpack.unpackb(m.encode(welcome(physics_profile("real"))))
    fields["physics"]["air"]["wind_mps"] = 3.0
    again = m.decode(msgpack.packb(fields), m.KINDS)
    assert again.physics == physics_profile("real"), "what a later version adds is ignored"
    for change, words in (
        ({"air": {}}, "drag_coefficient: a setting is missing"),
        ({"table": 3}, "not a map of settings"),
        ({"net_drag": "much" * 1000}, "not a finite number"),
        ({"net_drag": 2.0}, "out of range"),
        ({"net_drag": float("nan")}, "not a finite number"),
    ):
        broken = {**fields, "physics": {**fields["physics"], **change}}
        with pytest.raises(LinkError, match=words) as error:
            m.decode(msgpack.packb(broken), m.KINDS)
        assert len(str(error.value)) <= 300


def test_a_server_that_says_nothing_of_its_physics_is_understood() -> None:
    fields = msgpack.unpackb(m.encode(welcome(PhysicsConfig())))
    del fields["physics"]
    assert m.decode(msgpack.packb(fields), m.KINDS).physics is None


def test_two_hundred_pieces_of_garbage_each_give_one_clear_error():
    rng = np.random.default_rng(5)
    whole = [m.encode(message) for message in examples()]
    refused = []
    for number in range(200):
        data = bytearray(whole[number % len(whole)])
        if number % 3 == 0:
            data = bytearray(rng.bytes(int(rng.integers(0, 400))))
        elif number % 3 == 1:
            data = data[: int(rng.integers(0, len(data)))]
        else:
            for at in rng.integers(0, len(data), 8):
                data[at] = rng.integers(0, 256)
        try:
            m.decode(bytes(data), ALL)
        except LinkError as error:
            refused.append(str(error))
    assert all("\n" not in line and len(line) < 400 for line in refused)
    assert len(refused) > 150  # a flipped bit in a number may still be a legal message


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "nonsense"}, "no such message"),
        ({"v": 2}, "another version"),
        ({"v": True}, "another version"),
        ({"speed_mps": 50.0}, "out of bounds"),
        ({"speed_mps": "5"}, "not a number"),
        ({"speed_mps": float("nan")}, "out of bounds"),
        ({"speed_mps": True}, "not a number"),
        ({"p_m": [0, 0]}, "not a vector"),
        ({"p_m": [0, 0, 0.3]}, "both p_m and v_mps"),
        ({"id": -1}, "whole number"),
        ({"id": 10**18 * 18}, "whole number"),
        ({"id": msgpack.ExtType(1, b"x")}, "not msgpack"),
    ],
)
def test_a_command_that_breaks_a_rule_is_refused_with_the_reason(changes, words):
    fields = {"v": m.VERSION, "kind": "serve", "id": 1, "speed_mps": 5.0, **changes}
    with pytest.raises(LinkError, match=words):
        m.decode(msgpack.packb(fields), m.COMMANDS)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x91" * 100_000,
        msgpack.packb({1: 2}),
        msgpack.packb([1]),
        msgpack.packb({"v": 1, "kind": ["serve"]}),
        b"\xdd\xff\xff\xff\xff",
        b"x" * (m.COMMAND_BYTES + 1),
    ],
    ids=["empty", "deep", "int keys", "list", "list kind", "huge length", "too long"],
)
def test_hostile_bytes_are_refused(data):
    with pytest.raises(LinkError):
        m.decode(data, m.COMMANDS, m.COMMAND_BYTES)


def test_columns_must_fit_each_other_their_time_and_the_sensor():
    fields = msgpack.unpackb(m.encode(batch()))
    for changes in ({"x_px": b"\0\0"}, {"on": b"\0" * 5}, {"since_us": b"\0" * 7}, {"end_us": 10_000}):
        with pytest.raises(LinkError):
            m.decode(msgpack.packb({**fields, **changes}), m.KINDS)
    with pytest.raises(LinkError, match="sensor"):
        m.decode(msgpack.packb({**fields, "width_px": 60}), m.KINDS).events()
    with pytest.raises(LinkError, match="backwards"):
        batch(since_us=np.array([9, 7, 11], np.uint32)).events()


def test_a_server_that_does_not_say_whether_it_has_a_robot_has_one() -> None:
    fields = msgpack.unpackb(m.encode(welcome(physics_profile("real"))))
    assert fields.pop("robot") is True
    assert m.decode(msgpack.packb(fields), m.KINDS).robot
    assert not m.decode(msgpack.packb(fields | {"robot": False}), m.KINDS).robot
    with pytest.raises(LinkError, match="not true or false"):
        m.decode(msgpack.packb(fields | {"robot": 1}), m.KINDS)
