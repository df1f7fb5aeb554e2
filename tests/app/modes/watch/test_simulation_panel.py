"""The table of returned balls."""

from app.modes.watch.simulation_panel import returned_html
from core.history.seen_outcomes import BallConditions, ReturnRate


def test_a_row_says_how_many_of_how_many_with_the_interval() -> None:
    table = returned_html((ReturnRate(BallConditions("built-in", "ball"), 47, 41),))
    assert "built-in · ball" in table and "41 of 47" in table and "75–94 %" in table


def test_a_row_says_which_speeds_it_mixes() -> None:
    conditions = BallConditions("built-in", "ball")
    assert "ball · 5 m/s<" in returned_html((ReturnRate(conditions, 2, 1, (5.0, 5.0)),))
    assert "ball · 5 to 8.5 m/s<" in returned_html((ReturnRate(conditions, 2, 1, (5.0, 8.5)),))


def test_names_are_never_markup() -> None:
    table = returned_html((ReturnRate(BallConditions("<b>x", "<i>"), 2, 1),))
    assert "<b>x" not in table and "&lt;b&gt;x · &lt;i&gt;" in table


def test_without_balls_it_says_so() -> None:
    assert "No ball" in returned_html(())
