"""Event cameras of this machine: packets, clocks, biases, and raw recording."""

from core.devices.camera_device import CameraDevice, CameraPacket, RawDevice, RawPacket
from core.devices.clock_fit import ClockEstimate, ClockFit
from core.devices.models import CameraModel

__all__ = ["CameraDevice", "CameraModel", "CameraPacket", "ClockEstimate", "ClockFit", "RawDevice", "RawPacket"]
