"""Recordings on disk: one way to open every format, and the writer of ours."""

from core.recordings.import_feeds import ImportOrder
from core.recordings.importing import check_import, import_recording
from core.recordings.opening import open_recording
from core.recordings.recording import CameraStream, Recording, Triggers, calibrations_of, knows_ball
from core.recordings.truth import BallTruth, PixelTruth
from core.recordings.writer import RecordingWriter

__all__ = [
    "BallTruth",
    "CameraStream",
    "ImportOrder",
    "PixelTruth",
    "Recording",
    "RecordingWriter",
    "Triggers",
    "calibrations_of",
    "check_import",
    "import_recording",
    "knows_ball",
    "open_recording",
]
