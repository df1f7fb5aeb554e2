"""What Label's panel says in words."""

import pytest

from app.modes.label.status import Checked, progress_html


@pytest.mark.parametrize(
    ("checked", "text"),
    [
        (Checked(1625, 0, 0), "0 of 1625 times checked, 0 labels<"),
        (Checked(1625, 1, 1), "1 of 1625 times checked, 1 label<"),
        (Checked(1625, 0, 1), "0 of 1625 times checked, 1 label, 1 between these times<"),
        (Checked(1625, 2, 5), "2 of 1625 times checked, 5 labels, 3 between these times<"),
    ],
)
def test_labels_beside_the_times_to_label_are_named_where_they_are_not_counted(checked: Checked, text: str) -> None:
    assert text in progress_html(checked)
