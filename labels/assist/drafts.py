"""Labels made from what the assistance found, with a provenance that says so."""

from __future__ import annotations

import numpy as np

from labels.assist.curve import Curve
from labels.assist.snap import Snap
from labels.model import Label, LabelState, PositionSource, Provenance


def label_from_snap(
    snap: Snap,
    *,
    state: LabelState = LabelState.VISIBLE,
    window_us: tuple[int, int] | None = None,
    rendering: str = "",
    time_spent_ms: int = 0,
) -> Label:
    """The label of a click that was snapped; window and rendering are those of the picture that was clicked."""
    return Label(
        t_us=snap.t_us,
        state=state,
        x_px=snap.x_px,
        y_px=snap.y_px,
        r_px=snap.r_px,
        covariance_px2=snap.covariance_px2,
        provenance=Provenance(
            source=PositionSource.SNAPPED, window_us=window_us, rendering=rendering, time_spent_ms=time_spent_ms
        ),
    )


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
