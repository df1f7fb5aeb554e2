"""Assistance: pure functions that turn events, detections and labels into better or faster labels."""

from labels.assist.blind import is_blind_sample, next_blind
from labels.assist.curve import interpolate
from labels.assist.flight import fit_flight
from labels.assist.propose import Proposals, accept, propose, steady_segment
from labels.assist.review import review_queue
from labels.assist.snap import Snap, snap
from labels.assist.stereo import check_stereo, epipolar_curve

__all__ = [
    "Proposals",
    "Snap",
    "accept",
    "check_stereo",
    "epipolar_curve",
    "fit_flight",
    "interpolate",
    "is_blind_sample",
    "next_blind",
    "propose",
    "review_queue",
    "snap",
    "steady_segment",
]
