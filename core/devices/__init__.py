"""Event cameras at this machine: their packets, clocks and biases, and what is recorded of them as it comes."""

from core.devices.camera_device import CameraDevice, CameraPacket, RawDevice, RawPacket
from core.devices.clock_fit import ClockEstimate, ClockFit
from core.devices.models import CameraModel

__all__ = ["CameraDevice", "CameraModel", "CameraPacket", "ClockEstimate", "ClockFit", "RawDevice", "RawPacket"]
