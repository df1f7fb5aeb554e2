import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from core.cameras.calibration.residual_picture import ResidualPanel, residual_svg
from core.events import SensorSize

pytestmark = pytest.mark.numeric


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


def test_the_bars_are_as_tall_as_residuals_of_their_size_are_many() -> None:
    # 90 residuals of 0.35 px, 45 of 0.65 and ten of 3 px: the largest bar is the first kind's, the last one stands at
    # the right edge, which is the 99th percentile.
    sizes = np.repeat([0.35, 0.65, 3.0], [90, 45, 10])
    residuals = np.column_stack([sizes, np.zeros(len(sizes))])
    one = ResidualPanel("a", SensorSize(640, 480), np.full((145, 2), 100.0), residuals, np.ones(145, bool))
    root = ElementTree.fromstring(residual_svg("", [one]))
    bars = [element for element in root.iter() if element.tag.endswith("rect") and element.get("fill") == "#ff8c28"]
    heights = np.array([float(bar.get("height", "nan")) for bar in bars])
    assert np.flatnonzero(heights).tolist() == [3, 6, 29], "thirty bars from 0 to 3 px"
    np.testing.assert_allclose(heights[[3, 6, 29]] / heights[3], [1.0, 0.5, 1 / 9], atol=0.01)
    feet = [float(bar.get("y", "nan")) + height for bar, height in zip(bars, heights, strict=True)]
    np.testing.assert_allclose(feet, feet[0], atol=0.11)
    texts = [element.text or "" for element in root.iter()]
    assert any("median 0.350, p95 3.000" in text for text in texts) and "1.50" in texts and "3.00" in texts


def test_nothing_at_all_is_a_picture_too() -> None:
    nothing = np.empty((0, 2))
    empty = ElementTree.fromstring(
        residual_svg("", [ResidualPanel("a", SensorSize(4, 4), nothing, nothing, np.empty(0, bool))])
    )
    texts = [element.text or "" for element in empty.iter()]
    assert any("a: 0 points, 0 left out" in text for text in texts)
    none = ElementTree.fromstring(residual_svg("", []))
    assert 0 < float(none.get("width", "0")) < float(empty.get("width", "0")), "no column without a camera"
    for root in (empty, none):
        numbers = [value for element in root.iter() for value in element.attrib.values()]
        assert not any("nan" in value or "inf" in value for value in numbers)
