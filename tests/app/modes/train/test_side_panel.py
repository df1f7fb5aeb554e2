"""What stands above the charts of a training."""

from app.modes.train.side_panel import curve_legend_html


def test_the_legend_says_what_is_drawn_across_and_that_the_fixed_balls_are_without_noise() -> None:
    html = curve_legend_html("first-1", ("other",), several_seeds=False)
    assert "Across: balls of the training" in html and "fixed balls, no noise" in html
    assert html.index("first-1") < html.index("other")
