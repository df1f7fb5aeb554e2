import xml.etree.ElementTree as ElementTree

import numpy as np

from core.cameras.calibration.residual_picture import ResidualPanel, residual_svg
from core.events import SensorSize


def panel(name: str, count: int, out: int = 0) -> ResidualPanel:
    rng = np.random.default_rng(0)
    used = np.arange(count) >= out
    return ResidualPanel(
        name, SensorSize(640, 480), rng.uniform(0, 480, (count, 2)), rng.normal(0, 1, (count, 2)), used
    )


def test_the_picture_is_well_formed_and_says_the_figures() -> None:
    svg = residual_svg("left & right", [panel("left", 50, out=3), panel("right", 40)])
    root = ElementTree.fromstring(svg)
    assert float(root.get("width", "0")) > 800
    assert "left &amp; right" in svg and "left: 47 points, 3 left out" in svg and "right: 40 points, 0 left out" in svg
    assert svg.count("fill='none'") == 3, "a ring for each point that was left out"


def test_nothing_at_all_is_a_picture_too() -> None:
    nothing = np.empty((0, 2))
    ElementTree.fromstring(
        residual_svg("", [ResidualPanel("a", SensorSize(4, 4), nothing, nothing, np.empty(0, bool))])
    )
    ElementTree.fromstring(residual_svg("", []))
