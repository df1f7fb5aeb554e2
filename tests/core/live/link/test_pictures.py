"""Pictures over the link: they come in order with their block, and only to who asks for them."""

from __future__ import annotations

import dataclasses
from contextlib import AbstractContextManager

import numpy as np
import pytest
import zmq

from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import CameraFrame, SensorSize
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.ring_recording import RingRecording
from core.live.worlds.world import Block
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually

SIZE = SensorSize(320, 240)
BLOCK_US = 10_000


def picture_of(end_us: int) -> CameraFrame:
    """What the frame camera sees in a block: grey in every second one, else in colour."""
    number = end_us // BLOCK_US
    shape = (6, 8) if number % 2 else (6, 8, 3)
    return CameraFrame(end_us - 2_000, 4_000, np.full(shape, number % 250, np.uint8))


class ServerWithPictures(SimulationServer):
    """A simulation beside which an ordinary camera takes a picture a block."""

    def _reply(self, number: int, error: str, *, hello: bool = False) -> m.Reply:
        reply = super()._reply(number, error, hello=hello)
        return dataclasses.replace(reply, frame_cameras=(m.CameraInfo.of("rgb", self._cameras["left"]),))

    def _publish(self, block: Block) -> None:
        number = block.end_us // BLOCK_US
        self._send("picture", m.PictureMessage.of("rgb", picture_of(block.end_us), self._session, number))
        super()._publish(block)


def serving_pictures() -> AbstractContextManager[SimulationServer]:
    return serving(ServerWithPictures(ServerConfig(), stereo_preset("side", SIZE), "tcp://127.0.0.1:0"))


class EventsOnly:
    """A listener as they were before there were pictures."""

    def __init__(self) -> None:
        self.states: list[m.WorldState] = []

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...
    def on_state(self, state: m.WorldState) -> None:
        if state.ends_block:
            self.states.append(state)


def test_every_picture_arrives_as_it_was_before_the_state_of_its_block_and_no_message_counts_as_lost() -> None:
    with serving_pictures() as server:
        client, ring, states = SimulationClient(server.address, timeout_s=PATIENCE_S), RingRecording(), EventsOnly()
        newest_us: list[tuple[int, int]] = []

        class Order(EventsOnly):
            def on_state(self, state: m.WorldState) -> None:
                times_us = ring.frames["rgb"].ends_us
                if state.ends_block and len(times_us):
                    newest_us.append((state.t_us, int(times_us[-1])))

        for listener in (ring, Order(), states):
            client.add_listener(listener)
        eventually(lambda: len(newest_us) > 10, "pictures")
        client.listen(False)
        eventually(lambda: server._topics.keys() == {m.ALIVE}, "the subscriptions to end")
        beat = client.state
        eventually(lambda: client.state is not beat, "a sign of life")
        client.listen(True)
        count = len(newest_us)
        eventually(lambda: len(newest_us) > count + 5, "pictures again")
        client.close()
    assert all(end_us == t_us for t_us, end_us in newest_us[1:])
    stream = ring.frames["rgb"]
    assert stream.calibration is not None and len(stream) > 15
    for number in range(stream.first, stream.first + len(stream)):
        found = stream.frame(number)
        expected = picture_of(found.t_us + 2_000)
        assert found.exposure_us == 4_000
        np.testing.assert_array_equal(found.image, expected.image)
    assert client.lost_messages == client.rejected_messages == 0


def test_who_asks_for_everything_as_older_clients_do_gets_all_but_pictures() -> None:
    with serving_pictures() as server:
        context = zmq.Context()
        older = context.socket(zmq.SUB)
        older.setsockopt(zmq.SUBSCRIBE, b"")
        older.connect(server.address)
        client, ring = SimulationClient(server.address, timeout_s=PATIENCE_S), RingRecording()
        client.add_listener(ring)
        eventually(lambda: len(ring.frames["rgb"]) > 5, "pictures for who asks for them")
        topics, seqs = set(), []
        while len(seqs) < 60:
            assert older.poll(int(PATIENCE_S * 1000))
            topic, data = older.recv_multipart()
            topics.add(topic)
            seqs.append(m.decode(data, m.KINDS).seq)
        client.close()
        context.destroy(linger=0)
    assert {b"events", b"state"} <= topics and b"picture" not in topics
    assert np.diff(seqs).tolist() == [1] * (len(seqs) - 1), "nothing seems lost"


def test_a_client_without_a_listener_for_pictures_does_not_ask_for_them() -> None:
    with serving_pictures() as server:
        client, states = SimulationClient(server.address, timeout_s=PATIENCE_S), EventsOnly()
        client.add_listener(states)
        eventually(lambda: len(states.states) > 5, "blocks")
        assert m.PICTURES not in server._topics
        client.close()


def test_a_picture_survives_the_wire_and_pixels_that_do_not_fit_are_refused() -> None:
    frame = CameraFrame(-1_500, 4_000, np.arange(60, dtype=np.uint8).reshape(4, 5, 3))
    sent = m.PictureMessage.of("rgb", frame, "s", 7)
    found = m.decode(m.encode(sent), m.KINDS)
    assert (found.camera, found.seq, found.frame().t_us, found.frame().exposure_us) == ("rgb", 7, -1_500, 4_000)
    np.testing.assert_array_equal(found.frame().image, frame.image)
    with pytest.raises(LinkError, match="not the pixels of a picture"):
        m.PictureMessage(
            session="s", seq=1, camera="rgb", t_us=0, exposure_us=1, width_px=5, height_px=4, pixels=frame.image[0, 0]
        )
