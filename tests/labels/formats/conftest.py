from __future__ import annotations

import numpy as np
import pytest

from core.events import SensorSize
from labels.formats import ImportContext, LabelSet
from labels.model import Label, LabelState, PositionSource, Provenance

SENSOR = SensorSize(1280, 720)


@pytest.fixture
def balls() -> LabelSet:
    """200 whole balls away from the edges, with radii, a picture without one now and then, and a camera named oddly."""
    rng = np.random.default_rng(4)
    labels = []
    for index in range(200):
        x, y, r = (float(value) for value in (rng.uniform(30, 1250), rng.uniform(30, 690), rng.uniform(2, 12)))
        labels.append(Label(t_us=1_000_000 + index * 2500, state=LabelState.VISIBLE, x_px=x, y_px=y, r_px=r))
        if index % 50 == 0:
            labels.append(Label(t_us=1_000_000 + index * 2500 + 7, state=LabelState.NO_BALL))
    return LabelSet("rec-1", "links/é.1", "anna", SENSOR, tuple(labels))


@pytest.fixture
def odd() -> LabelSet:
    """One label of each kind that formats find hard."""
    made = Provenance(
        source=PositionSource.SNAPPED,
        annotator='Åsa, the "second"\nline',
        made_at_us=12,
        tool="t",
        detector="auto#1",
        window_us=(0, 2000),
        rendering="count",
        time_spent_ms=900,
    )
    labels = (
        Label(t_us=0, state=LabelState.VISIBLE, x_px=0.0, y_px=0.0, r_px=5.0),
        Label(t_us=1, state=LabelState.VISIBLE, x_px=1279.0, y_px=719.0, r_px=9.0, provenance=made),
        Label(t_us=2, state=LabelState.PARTLY_OCCLUDED, x_px=500.25, y_px=300.75, covariance_px2=(0.1, 0.0, 0.2)),
        Label(t_us=3, state=LabelState.OCCLUDED),
        Label(t_us=4, state=LabelState.OCCLUDED, x_px=600.125, y_px=20.5, r_px=4.0),
        Label(t_us=5, state=LabelState.OUT_OF_FRAME, x_px=-30.0, y_px=50.0, r_px=6.0),
        Label(t_us=6, state=LabelState.OUT_OF_FRAME),
        Label(t_us=7, state=LabelState.NO_BALL),
        Label(t_us=123_456_789_012, state=LabelState.VISIBLE, x_px=100.0, y_px=100.0),
    )
    return LabelSet("rec-1", "left", "anna", SENSOR, labels)


@pytest.fixture
def context() -> ImportContext:
    return ImportContext(SENSOR)
