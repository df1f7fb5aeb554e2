"""Recordings on disk: one way to open every format, and the writer of ours."""

from core.recordings.recording import CameraStream, Recording, Triggers
from core.recordings.truth import BallTruth, PixelTruth

__all__ = ["BallTruth", "CameraStream", "PixelTruth", "Recording", "Triggers"]
