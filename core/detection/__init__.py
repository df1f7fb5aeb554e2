"""Ball detection in event windows: one file per stage, the readable pipeline, the fast path, the adaptive ROI."""

from core.detection.detector import Detection, Detector

__all__ = ["Detection", "Detector"]
