"""Event cameras with the library neuromorphic-drivers; the only module that uses it.

No camera was at hand when this was written. What turns its packets into ours (`read`, `read_raw`) is tested with
packets of the library's own types; that a plugged-in camera is listed, opened, configured and closed as it is asked
here rests on the library's source and type stubs: those lines, marked HARDWARE, have been run by replayed cameras only.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from core.devices.camera_device import CameraPacket, ClockRole, RawPacket
from core.devices.models import MODELS, Bias, CameraModel, check_biases
from core.errors import DeviceError

LIBRARY: Final = "neuromorphic_drivers"
WAIT_S: Final = 0.1
"""Longest wait for a packet; then the reader checks whether it is to stop."""
_CLOCKS: Final = {"own": "INTERNAL", "leads": "INTERNAL_WITH_OUTPUT_ENABLED", "follows": "EXTERNAL"}
_PERMISSION: Final = "is it in use by another program? On Linux, run neuromorphic-drivers-install-udev-rules once"


@dataclass(frozen=True, slots=True)
class ListedCamera:
    """A camera that is plugged in."""

    name: str
    serial: str | None
    """None where it could not be read."""
    connection: str
    problem: str | None
    """Why it cannot be used; empty if it can."""


def load_driver() -> Any:
    """The library.

    Raises:
        DeviceError: if it is not installed.
    """
    try:
        return importlib.import_module(LIBRARY)
    except ImportError as error:
        raise DeviceError(
            "event cameras need a driver that is not installed",
            got=str(error),
            remedy="install it with: pip install 'rallyscope[camera]'",
        ) from error


def list_cameras(driver: Any = None) -> tuple[ListedCamera, ...]:
    """List the cameras that are plugged in, usable or not.

    Raises:
        DeviceError: if the library is not installed, or USB cannot be asked.
    """
    driver = driver or load_driver()
    try:
        listed = driver.list_devices()  # HARDWARE
    except RuntimeError as error:
        raise DeviceError("the cameras cannot be listed", got=error, remedy="is there USB on this machine?") from error
    return tuple(ListedCamera(one.name.value, one.serial, one.connection.value, one.error) for one in listed)


def open_camera(
    serial: str,
    *,
    role: ClockRole = "own",
    biases: Mapping[str, Mapping[str, int]] | None = None,
    raw: bool = False,
    driver: Any = None,
) -> DriverCamera:
    """The camera with a serial number; with its biases, or those of its model, if there are some.

    Raises:
        DeviceError: if it is not there, is of a model that is not known here, or cannot be opened in this role.
        ConfigError: if a bias is out of the bounds of this very camera.
    """
    driver = driver or load_driver()
    model = _model_of(serial, list_cameras(driver))
    if role != "own" and not model.cable:
        raise DeviceError("no sync cable with such a camera", got=model.name, where=serial, remedy="omit --sync-cable")
    if raw and not model.evt3:
        raise DeviceError("its bytes cannot be recorded as they come", got=model.name, where=serial)
    configuration = getattr(driver, model.module).Configuration()
    if role != "own":
        configuration.clock = getattr(getattr(driver, model.module).Clock, _CLOCKS[role])
    known = biases or {}
    values = dict(known.get(f"{model.name} {serial}", known.get(model.name, {})))
    check_biases(model.biases, values, serial)
    for name, value in values.items():
        setattr(configuration.biases, name, value)
    try:
        device = driver.open(configuration, iterator_timeout=WAIT_S, raw=raw, serial=serial)  # HARDWARE
    except RuntimeError as error:
        raise DeviceError("the camera cannot be opened", got=error, where=serial, remedy=_PERMISSION) from error
    return DriverCamera(device, model, serial, configuration)


def describe_cameras(cameras: tuple[ListedCamera, ...]) -> str:
    """One line about all cameras."""
    if not cameras:
        return "no event camera is plugged in"
    return ", ".join(f"{one.serial or one.problem or 'unknown serial'} ({one.name})" for one in cameras)


class DriverCamera:
    """An open camera, a CameraDevice or, if it was opened so, a RawDevice. Whoever reads it closes it."""

    def __init__(self, device: Any, model: CameraModel, serial: str, configuration: Any) -> None:
        self.serial, self.model = serial, model
        self._device, self._configuration = device, configuration
        bounds = device.biases_bounds()
        self.biases: tuple[Bias, ...] = tuple(
            bias.within(getattr(bounds, bias.name).minimum, getattr(bounds, bias.name).maximum) for bias in model.biases
        )
        self._complete_us = 0
        self._dropped = 0

    def bias_values(self) -> dict[str, int]:
        """Values set here or by default."""
        return {bias.name: int(getattr(self._configuration.biases, bias.name)) for bias in self.biases}

    def set_biases(self, values: Mapping[str, int]) -> None:
        """Set some of them; all or none."""
        check_biases(self.biases, values, self.serial)
        before = self.bias_values()
        for name, value in values.items():
            setattr(self._configuration.biases, name, value)
        try:
            self._device.update_configuration(self._configuration)  # HARDWARE
        except RuntimeError as error:
            for name, value in before.items():
                setattr(self._configuration.biases, name, value)
            raise DeviceError("the camera does not take the biases", got=error, where=self.serial) from error

    def read(self) -> CameraPacket | None:
        """The next packet, decoded."""
        status, packet, now_s = self._next()
        ring = status.ring
        if ring is None or packet is None:
            return None
        events = packet.polarity_events
        complete_us = max(self._complete_us, int(ring.current_t))
        # Of merged packets the library tells when the first came, and how far the last one goes.
        stamp_us = complete_us if ring.raw_packets == 1 else self._complete_us
        if ring.raw_packets != 1 and events is not None and len(events):
            stamp_us = int(events["t"][0])
        self._complete_us = complete_us
        gap = packet.polarity_events_overflow_indices is not None or ring.dropped_packets > self._dropped
        self._dropped = int(ring.dropped_packets)
        return CameraPacket(_arrival_s(status, now_s), stamp_us, complete_us, events, self._dropped, gap)

    def read_raw(self) -> RawPacket | None:
        """The next bytes."""
        status, data, now_s = self._next()
        ring = status.ring
        if ring is None or data is None:
            return None
        gaps = tuple(int(index) for index in ring.overflow_indices or ())
        return RawPacket(_arrival_s(status, now_s), data, int(ring.dropped_packets), gaps, ring.raw_packets == 1)

    def close(self) -> None:
        """Close the camera."""
        self._device.close()  # HARDWARE

    def _next(self) -> tuple[Any, Any, float]:
        try:
            status, packet = next(self._device)  # HARDWARE
        except (RuntimeError, StopIteration) as error:
            raise DeviceError(
                "the camera is gone", got=error, where=self.serial, remedy="plug it in and start Rallyscope again"
            ) from error
        return status, packet, time.monotonic()


def _arrival_s(status: Any, now_s: float) -> float:
    """When the packet had come, on the monotonic clock: the library tells two times of the clock that may be set."""
    return now_s - max(0.0, float(np.nan_to_num(status.system_time - status.ring.system_time)))


def _model_of(serial: str, cameras: tuple[ListedCamera, ...]) -> CameraModel:
    for one in cameras:
        if one.serial == serial:
            model = MODELS.get(one.name)
            if model is None:
                raise DeviceError(
                    "this model is not known here", expected=" or ".join(MODELS), got=one.name, where=serial
                )
            return model
    raise DeviceError("no such camera", expected=describe_cameras(cameras), got=serial)
