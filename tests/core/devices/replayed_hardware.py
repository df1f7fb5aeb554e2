"""Recordings in place of cameras: a stand-in for the camera library.

For tests and benchmarks of everything behind the library. It stands for the library itself: it lists its cameras, opens
them, and gives packets of the library's own types, decoded or as bytes, at the pace of the recording. A ring of packets
that are not read in time is lost from its newest end, as the library's is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from core.devices.models import EVK4, CameraModel
from core.devices.neuromorphic import load_driver
from core.events import Events, SensorSize
from core.recordings.evt3_encoder import LOW_BITS, Evt3Encoder

DTYPE: Final = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
"""Layout of the library's polarity events."""
PACKET_US: Final = 1000
MAX_MERGED: Final = 64
"""Packets that the library makes one of, if they have waited."""
RING: Final = 4096
ENDLESS: Final = 10**9
"""A ring in which everything finds room, however long the machine stands still."""


class RecordedStream(Protocol):
    """What a camera saw: a camera of a recording, or what has the same two members."""

    @property
    def sensor(self) -> SensorSize: ...
    def slice(self, start_us: int, end_us: int) -> Events: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """A simulated camera that replays a recording."""

    stream: RecordedStream
    duration_us: int
    """After which it sends time and no events."""
    model: CameraModel = EVK4
    offset_us: int = 0
    """Its clock at the recording's time 0."""
    drift: float = 0.0
    """Seconds that this machine's clock gains on it in a second."""
    jitter_s: float = 0.0
    """Largest random delay of packets."""
    speed: float = 1.0
    ring: int = RING
    """Capacity of its packet buffer."""


class ReplayedLibrary:
    """What `neuromorphic_drivers` is to `core.devices.neuromorphic`, with cameras by serial number."""

    def __init__(
        self, cameras: Mapping[str, Replayed], *, hold: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """All cameras begin to see when the last of them is opened, as with a sync cable, or, if held, at `begin`."""
        self.real = load_driver()
        self.cameras, self.clock = dict(cameras), clock
        self.opened: list[ReplayedDevice] = []
        self.began_s: float | None = None
        self._hold = hold

    def begin(self) -> None:
        """Start the replay."""
        self.began_s = self.clock()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)

    def list_devices(self) -> list[Any]:
        """Devices in the form of the camera library."""
        speed = self.real.Connection.USB_SUPER
        return [
            self.real.ListedDevice(self.real.Name(one.model.name), speed, "", serial, None)
            for serial, one in self.cameras.items()
        ]

    def open(self, configuration: Any, *, iterator_timeout: float, raw: bool, serial: str) -> ReplayedDevice:
        """Open a device as the camera library does."""
        device = ReplayedDevice(self, self.cameras[serial], configuration, iterator_timeout, raw=raw)
        self.opened.append(device)
        if len(self.opened) == len(self.cameras) and not self._hold:
            self.begin()
        return device


class ReplayedDevice:
    """What the library's open camera is, as far as it is used."""

    def __init__(
        self, library: ReplayedLibrary, camera: Replayed, configuration: Any, timeout_s: float, *, raw: bool
    ) -> None:
        self.configuration = configuration
        self.unplugged = self.closed = False
        self.events_dropped = 0
        """What no real camera can tell: how many events were lost with the packets."""
        self._library, self._camera, self._timeout_s, self._raw = library, camera, timeout_s, raw
        self._encoder = Evt3Encoder()
        self._sent = self._dropped = 0
        self._rng = np.random.default_rng(len(library.opened))
        self._late_s = 0.0

    @property
    def sent_us(self) -> int:
        """How much of the recording has been read, or lost."""
        return self._sent * PACKET_US

    def biases_bounds(self) -> Any:
        """All that fits into a number of this camera's."""
        bounds = self._library.real.__dict__[self._camera.model.module]
        low = -128 if self._camera.model is EVK4 else 0
        names = bounds.BiasesBounds.__dataclass_fields__
        return bounds.BiasesBounds(**{name: bounds.Bounds(low, low + 2047) for name in names})

    def update_configuration(self, configuration: Any) -> None:
        """Store the configuration."""
        self.configuration = configuration
        configuration.serialize()

    def close(self) -> None:
        """Stop the replay."""
        self.closed = True

    def __iter__(self) -> ReplayedDevice:
        return self

    def __next__(self) -> tuple[Any, Any]:
        if self.unplugged or self.closed:
            raise RuntimeError("the device was disconnected" if self.unplugged else "__next__ called after __exit__")
        status = self._library.real.status
        kinds = (status.RawStatus, status.RawRingStatus) if self._raw else (status.Status, status.RingStatus)
        if not self._wait():
            return kinds[0](system_time=time.time(), ring=None), None
        waiting = self._come() - self._sent
        gaps = [0] if self._drop(waiting - self._camera.ring) else []
        count = min(MAX_MERGED, max(1, self._come() - self._sent))
        first = self._sent
        packet = self._bytes(count) if self._raw else self._decoded(count, gaps)
        self._sent += count
        now_s, received_s = time.time(), self._library.clock() - self._arrival_s(first)
        came = {
            "system_time": now_s - max(0.0, received_s), "backlog": max(0, waiting - count), "raw_packets": count,
            "clutch_engaged": False, "dropped_packets": self._dropped,
        }  # fmt: skip
        stamp_us = self._stamp_us(self._sent * PACKET_US)
        came |= {"overflow_indices": gaps or None} if self._raw else {"current_t": stamp_us}
        return kinds[0](system_time=now_s, ring=kinds[1](**came)), packet

    def _arrival_s(self, number: int) -> float:
        """When a packet is here: after its last event."""
        assert self._library.began_s is not None
        return self._library.began_s + (number + 1) * PACKET_US * 1e-6 / self._camera.speed + self._late_s

    def _come(self) -> int:
        """How many packets have come."""
        began_s = self._library.began_s
        if began_s is None:
            return 0
        return int((self._library.clock() - began_s - self._late_s) * self._camera.speed * 1e6 / PACKET_US)

    def _wait(self) -> bool:
        self._late_s = float(self._rng.random()) * self._camera.jitter_s
        until_s = self._library.clock() + self._timeout_s
        while self._come() <= self._sent:
            if self._library.clock() >= until_s or self.unplugged:
                return False
            due_s = until_s if self._library.began_s is None else self._arrival_s(self._sent)
            time.sleep(min(0.01, max(1e-4, due_s - self._library.clock())))
        return True

    def _drop(self, count: int) -> bool:
        """Lose the packets that found no room in the ring."""
        if count <= 0:
            return False
        lost = self._events(self._sent, count)
        self.events_dropped += len(lost)
        self._encoder.encode(lost)
        self._sent += count
        self._dropped += count
        return True

    def _events(self, first: int, count: int) -> Events:
        """What was seen in some packets, on the camera's clock."""
        end_us = min((first + count) * PACKET_US, self._camera.duration_us)
        seen = self._camera.stream.slice(min(first * PACKET_US, end_us), end_us)
        if not self._camera.offset_us and not self._camera.drift:
            return seen
        t_us = self._camera.offset_us + np.floor(seen.t_us / (1.0 + self._camera.drift)).astype(np.int64)
        return Events.from_columns(t_us, seen.x_px, seen.y_px, seen.on, seen.sensor)

    def _stamp_us(self, t_us: int) -> int:
        return self._camera.offset_us + int(np.floor(t_us / (1.0 + self._camera.drift)))

    def _decoded(self, count: int, gaps: list[int]) -> Any:
        events = self._events(self._sent, count)
        found = np.empty(len(events), DTYPE)
        for name, column in zip(DTYPE.names or (), (events.t_us, events.x_px, events.y_px, events.on), strict=True):
            found[name] = column
        real = self._library.real.packet
        packet = {"prophesee": real.Evt3Packet, "inivation_dv": real.DvxplorerPacket}.get(
            self._camera.model.module[: 9 if self._camera.model.evt3 else 12], real.Davis346Packet
        )()
        packet.polarity_events = found if len(found) else None
        packet.trigger_events = None
        packet.polarity_events_overflow_indices = np.array(gaps, np.uint64) if gaps else None
        return packet

    def _bytes(self, count: int) -> bytes:
        """The words of the events, and of the coarse time even where there are none."""
        words = self._encoder.encode(self._events(self._sent, count))
        quiet = self._encoder.advance(self._stamp_us((self._sent + count) * PACKET_US - 1) >> LOW_BITS)
        return np.concatenate([words, quiet]).astype("<u2").tobytes()
