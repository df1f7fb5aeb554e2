"""Interface of an event camera: timed packets, and biases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from numpy.typing import NDArray

from core.devices.models import Bias, CameraModel

ClockRole = Literal["own", "leads", "follows"]
"""Clock of a camera: its own; its own, passed to another camera over a sync cable; that of the other camera."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPacket:
    """Packet of a camera; it may have no events but only a time."""

    host_s: float
    """Arrival time on this machine's monotonic clock, s."""
    stamp_us: int
    """A time of the camera's clock that had passed when the packet came."""
    complete_us: int
    """All events before this time of the camera's clock have arrived."""
    events: NDArray | None
    """Structured (t, x, y, on), on the camera's clock."""
    packets_dropped: int
    """USB packets dropped since the camera was opened, because this machine was too busy to read them."""
    gap: bool
    """Whether data was dropped just before it, or within it."""


@dataclass(frozen=True, slots=True)
class RawPacket:
    """Bytes as they came from the camera."""

    host_s: float
    data: bytes
    packets_dropped: int
    gaps: tuple[int, ...]
    """Offsets in `data`, bytes, where data is missing."""
    alone: bool
    """Whether it was not merged with later ones: then all of it had been stamped at `host_s`."""


class OpenCamera(Protocol):
    """An open camera. One thread reads it; all other methods are thread-safe."""

    @property
    def serial(self) -> str: ...
    @property
    def model(self) -> CameraModel: ...
    @property
    def biases(self) -> tuple[Bias, ...]:
        """Biases with the bounds of this camera."""
        ...

    def bias_values(self) -> dict[str, int]:
        """Current values of the biases."""
        ...

    def set_biases(self, values: Mapping[str, int]) -> None:
        """Set some of them.

        Raises:
            ConfigError: if there is no such bias, or it is out of its bounds; then none is set.
            DeviceError: if the camera does not take them.
        """
        ...

    def close(self) -> None: ...


class CameraDevice(OpenCamera, Protocol):
    """A camera whose packets are decoded by the driver."""

    def read(self) -> CameraPacket | None:
        """The next packet; None if nothing came within a tenth of a second.

        Raises:
            DeviceError: if the camera is gone.
        """
        ...


class RawDevice(OpenCamera, Protocol):
    """A camera that is read as raw bytes."""

    def read_raw(self) -> RawPacket | None:
        """The next bytes; None if nothing came within a tenth of a second.

        Raises:
            DeviceError: if the camera is gone.
        """
        ...
