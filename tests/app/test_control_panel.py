"""The legend of the pictures."""

from app.control_panel import event_legend_html


def test_the_legend_speaks_of_a_truth_only_where_one_is_known() -> None:
    assert "truth" in event_legend_html("orange / blue", with_truth=True)
    without = event_legend_html("orange / blue", with_truth=False)
    assert "truth" not in without and all(word in without for word in ("found", "ROI", "ON", "OFF"))
