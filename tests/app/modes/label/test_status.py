"""What Label's panel says in words."""

import math

import pytest

from app.modes.label.panel import shown_numbers
from app.modes.label.status import Checked, progress_html
from labels.model import Label, LabelState


@pytest.mark.parametrize(
    ("checked", "text"),
    [
        (Checked(1625, 0, 0), "0 of 1,625 times checked, 0 labels<"),
        (Checked(1625, 1, 1), "1 of 1,625 times checked, 1 label<"),
        (Checked(1625, 0, 1), "0 of 1,625 times checked, 1 label, 1 between these times<"),
        (Checked(1625, 2, 5), "2 of 1,625 times checked, 5 labels, 3 between these times<"),
    ],
)
def test_labels_beside_the_times_to_label_are_named_where_they_are_not_counted(checked: Checked, text: str) -> None:
    assert text in progress_html(checked)


def test_where_no_label_is_there_is_no_place_and_no_radius() -> None:
    """Zeros would say that the ball is in the corner of the picture."""
    assert all(map(math.isnan, shown_numbers(None, None)))
    assert all(map(math.isnan, shown_numbers(Label(t_us=5, state=LabelState.NO_BALL), None)))
    assert shown_numbers(Label(t_us=5, state=LabelState.VISIBLE, x_px=1.23456, y_px=0.0), None) == (1.235, 0.0, 0.0)
