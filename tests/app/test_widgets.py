"""Options of charts."""

import numpy as np
import pytest

from app.modes.train.side_panel import _axes as train_axes
from app.modes.tune.compare_panel import STEP_RANGE_MS
from app.modes.tune.compare_panel import _scales as compare_scales
from app.widgets import decades, log_scale, plot_axis


@pytest.mark.parametrize(
    ("low", "high", "lines"),
    [
        (10.0, 1_000.0, (10.0, 100.0, 1_000.0)),
        (1.0, 2_000.0, (1.0, 10.0, 100.0, 1_000.0)),
        (0.01, 30.0, (0.01, 0.1, 1.0, 10.0)),
        (0.02, 0.05, ()),
    ],
)
def test_a_logarithmic_axis_has_lines_at_powers_of_ten_within_its_scale_only(low, high, lines) -> None:
    assert decades(low, high) == lines
    assert plot_axis("mm", decades(low, high)).get("splits") == lines


def test_a_logarithmic_scale_has_no_place_for_a_missing_value() -> None:
    # uPlot puts what is not above 0, NaN too, at the lower end of its own logarithmic scale (3).
    scale = log_scale(10.0, 1_000.0)
    assert (scale.get("distr"), scale.get("asinh")) == (4, 1.0) and scale.get("range") == (10.0, 1_000.0)
    assert compare_scales("step", np.arange(3.0), [])["y"] == log_scale(*STEP_RANGE_MS), "a method may have no curve"


def test_the_chart_of_errors_has_lines_at_powers_of_ten_and_the_others_what_fits() -> None:
    of_errors, of_rewards = (
        train_axes(name, ends, (), 1) for name, ends in (("error_mm", (10, 1e4)), ("reward", (0, 4)))
    )
    assert of_errors[1].get("splits") == (10.0, 100.0, 1_000.0, 10_000.0)
    assert of_errors[1].get("size") == of_rewards[1].get("size"), "charts below each other begin at one place"
    assert "splits" not in of_rewards[1] and "splits" not in of_errors[0]
