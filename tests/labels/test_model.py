from __future__ import annotations

import math

import pytest

from core.errors import LabelError
from labels.journal import label_from_json
from labels.model import Label, LabelState, Provenance

RECORD = {"t_us": 3, "state": "no_ball", "source": "by_hand", "by": "anna", "at_us": 5, "tool": "t 1"}
"""As version 1 wrote it."""


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"t_us": -1, "state": LabelState.NO_BALL}, "impossible time"),
        ({"t_us": 2**63, "state": LabelState.NO_BALL}, "impossible time"),
        ({"t_us": 1, "state": LabelState.VISIBLE}, "without a position"),
        ({"t_us": 1, "state": LabelState.PARTLY_OCCLUDED, "x_px": 1.0}, "half a position"),
        ({"t_us": 1, "state": LabelState.NO_BALL, "x_px": 1.0, "y_px": 1.0}, "no ball"),
        ({"t_us": 1, "state": LabelState.VISIBLE, "x_px": math.nan, "y_px": 1.0}, "not finite"),
        ({"t_us": 1, "state": LabelState.VISIBLE, "x_px": 1.0, "y_px": 1.0, "r_px": 0.0}, "radius"),
        ({"t_us": 1, "state": LabelState.VISIBLE, "x_px": 1.0, "y_px": 1.0, "covariance_px2": (1, 2, 1)}, "covariance"),
    ],
)
def test_an_impossible_label_is_refused_with_its_time(values: dict, message: str) -> None:
    with pytest.raises(LabelError, match=message) as caught:
        Label(**values)
    assert f"label at {values['t_us']} us" in str(caught.value)


def test_an_empty_window_is_refused() -> None:
    with pytest.raises(LabelError, match="window"):
        Provenance(window_us=(5, 5))


@pytest.mark.parametrize("state", [LabelState.OCCLUDED, LabelState.OUT_OF_FRAME])
def test_hidden_balls_may_have_a_position_or_none(state: LabelState) -> None:
    assert Label(t_us=0, state=state).x_px is None
    assert Label(t_us=0, state=state, x_px=-50.0, y_px=3.0).x_px == -50.0
    assert not state.seen


@pytest.mark.parametrize("key", ["t_us", "state", "source", "by", "at_us", "tool"])
def test_a_record_without_a_field_is_an_error_that_names_it(key: str) -> None:
    values = {name: value for name, value in RECORD.items() if name != key}
    with pytest.raises(LabelError, match=key):
        label_from_json(values)


@pytest.mark.parametrize(
    "change",
    [{"t_us": 1.5}, {"x": "3"}, {"state": "gone"}, {"cov": [1, 2]}, {"window_us": [1]}, {"at_us": None}, {"r": True}],
)
def test_a_record_with_a_wrong_value_is_an_error(change: dict) -> None:
    values = {**RECORD, "state": "visible", "x": 1.0, "y": 2.0}
    assert label_from_json(values).x_px == 1.0
    with pytest.raises(LabelError):
        label_from_json({**values, **change})
