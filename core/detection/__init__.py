"""Ball detection in event windows: one file per stage, the readable pipeline, the fast path, the adaptive ROI."""

from core.detection.config import (
    DetectorConfig,
    auto_config,
    ebpp_config,
    fe_fusion_config,
    paper_config,
    refined_config,
)
from core.detection.detector import Detection, Detector
from core.detection.fast.detector import FastDetector
from core.detection.methods import make_detector, register_detector
from core.detection.pipeline import ReferenceDetector, trace_window
from core.detection.refined.detector import RefinedDetection, RefinedDetector
from core.detection.stage_trace import Candidate, PipelineTrace, StageTrace, TrackState

__all__ = [
    "Candidate",
    "Detection",
    "Detector",
    "DetectorConfig",
    "FastDetector",
    "PipelineTrace",
    "ReferenceDetector",
    "RefinedDetection",
    "RefinedDetector",
    "StageTrace",
    "TrackState",
    "auto_config",
    "ebpp_config",
    "fe_fusion_config",
    "make_detector",
    "paper_config",
    "refined_config",
    "register_detector",
    "trace_window",
]
