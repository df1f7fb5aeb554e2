"""Assistance: pure functions that turn events, detections and labels into better or faster labels."""

from labels.assist.between import labels_between, labels_from_curve
from labels.assist.blind import is_blind_sample, next_blind
from labels.assist.contact_proposals import propose_contacts
from labels.assist.curve import interpolate
from labels.assist.flight import curve_of_flight, fit_flight
from labels.assist.propose import Proposals, accept, propose, steady_segment
from labels.assist.review import review_queue
from labels.assist.snap import Snap, snap
from labels.assist.snap_kernel import load_snap
from labels.assist.stereo import ball_in_space, check_labels, check_stereo, epipolar_curve, reproject
from labels.assist.whole_flight import WholeFlight, whole_flight

__all__ = [
    "Proposals",
    "Snap",
    "WholeFlight",
    "accept",
    "ball_in_space",
    "check_labels",
    "check_stereo",
    "curve_of_flight",
    "epipolar_curve",
    "fit_flight",
    "interpolate",
    "is_blind_sample",
    "labels_between",
    "labels_from_curve",
    "load_snap",
    "next_blind",
    "propose",
    "propose_contacts",
    "reproject",
    "review_queue",
    "snap",
    "steady_segment",
    "whole_flight",
]
