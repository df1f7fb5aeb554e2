"""Labels for the unlabelled times between labelled ones, by a flight in space where one fits, else by a curve,
with a provenance that says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from labels.arrays import LabelArrays
from labels.assist.curve import Curve, interpolate
from labels.assist.flight import curve_of_flight, fit_flight
from labels.model import Label, LabelState, PositionSource, Provenance


def labels_from_curve(curve: Curve, *, made_of: str = "curve") -> tuple[Label, ...]:
    """A label for every covered time of an interpolation; `made_of` says by what (a flight is made a curve first)."""
    labels = []
    for row in np.flatnonzero(curve.covered).tolist():
        radius, variance = float(curve.r_px[row]), float(curve.sigma_px[row]) ** 2
        labels.append(
            Label(
                t_us=int(curve.t_us[row]),
                state=LabelState.VISIBLE,
                x_px=float(curve.x_px[row]),
                y_px=float(curve.y_px[row]),
                r_px=radius if np.isfinite(radius) else None,
                covariance_px2=(variance, 0.0, variance),
                provenance=Provenance(source=PositionSource.INTERPOLATED, detector=made_of),
            )
        )
    return tuple(labels)


REACH_US: Final = 1_000_000
"""Labels so far outside the times that are asked for have no say: fits and breaks are local."""


def labels_between(
    keys: LabelArrays,
    others: Sequence[LabelArrays],
    cameras: Sequence[Camera],
    times_us: NDArray[np.int64],
    t_us: int,
    breaks_us: tuple[int, ...],
) -> tuple[Label, ...]:
    """Labels for the unlabelled ones of some times in the segment of `keys` that holds `t_us`, or is nearest to it.

    `others` are the labels of other cameras, `cameras` the calibrations of the own and of those, in this order; with
    two or more a flight is fitted to all cameras' labels.
    Nothing is interpolated across `breaks_us`, bounces and hits.

    Args:
        keys: labels of the own camera.
        others: labels of the other cameras.
        cameras: calibrations, the own first.
        times_us: (N,) unlabelled times, ascending.
        t_us: time that says which segment.
        breaks_us: bounces and hits.
    """
    if not len(times_us):
        return ()
    keys = keys.between(int(times_us[0]) - REACH_US, int(times_us[-1]) + REACH_US)  # of hundreds of thousands, perhaps
    plain = interpolate(keys, times_us, breaks_us=breaks_us)
    if not plain.covered.any():
        return ()
    nearest = int(np.flatnonzero(plain.covered)[np.argmin(np.abs(plain.t_us[plain.covered] - t_us))])
    inside = times_us[plain.segment == plain.segment[nearest]]
    if np.isin(inside, keys.t_us).all():  # nothing is left to label: no flight need be fitted
        return ()
    curve, made_of = plain, "curve"
    if len(cameras) > 1:
        span = int(inside[0]) - 1, int(inside[-1]) + 2
        flight = fit_flight(cameras, [part.between(*span) for part in (keys, *others)])
        if flight is not None:
            curve, made_of = curve_of_flight(flight, cameras[0], times_us), "flight"
    free = np.isin(curve.t_us, inside) & ~np.isin(curve.t_us, keys.t_us) & curve.covered
    return labels_from_curve(_rows(curve, free), made_of=made_of)


def _rows(curve: Curve, rows: NDArray[np.bool_]) -> Curve:
    return Curve(
        curve.t_us[rows],
        curve.x_px[rows],
        curve.y_px[rows],
        curve.r_px[rows],
        curve.sigma_px[rows],
        curve.segment[rows],
    )
