"""The labels of one camera held against those of the other, which need not be of the same instants."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from labels.arrays import LabelArrays
from labels.assist.curve import interpolate
from labels.assist.stereo import StereoCheck, check_stereo


def check_labels(here: Camera, labels: LabelArrays, there: Camera, others: LabelArrays) -> StereoCheck:
    """How well each label agrees with the other camera's label of its instant, or with the curve through them.

    nan where either camera sees no ball, and where the other camera's labels do not reach.
    """
    uv_here = np.column_stack([labels.x_px, labels.y_px])
    uv_here[~labels.seen] = np.nan
    return check_stereo(here, uv_here, there, labelled_positions_at(others, labels.t_us))


def labelled_positions_at(labels: LabelArrays, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N, 2) where labels say the ball is at other times: a label itself where there is one, else the curve."""
    curve = interpolate(labels, t_us)
    places = np.column_stack([curve.x_px, curve.y_px])
    seen = labels.rows(labels.seen)
    _, own, at = np.intersect1d(seen.t_us, t_us, return_indices=True)
    places[at] = np.column_stack([seen.x_px, seen.y_px])[own]
    return places
