"""A table of shares as a picture."""

from xml.etree import ElementTree

import numpy as np

from core.bench.heat_map import heat_map


def test_every_cell_says_its_share_and_of_how_many_and_an_empty_one_says_nothing() -> None:
    shares, counts = np.array([[0.25, 1.0], [0.0, 0.0]]), np.array([[4, 1200], [7, 0]])
    svg = ElementTree.fromstring(heat_map("A < B", "x", "y", ["1", "2"], ["low", "high"], shares, counts))
    texts = [element.text for element in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert "A < B" in texts and [text for text in texts if text and text.endswith("%")] == ["25 %", "100 %", "0 %"]
    assert "of 1,200" in texts and "of 0" not in texts
    cells = [element.get("fill") for element in svg.iter("{http://www.w3.org/2000/svg}rect")][1:]
    assert cells[1] == "#e8590c" and cells[2] == "#f1f3f5" and cells[3] == "#ffffff"
    rows = {element.text: float(element.get("y") or 0) for element in svg.iter("{http://www.w3.org/2000/svg}text")}
    assert rows["low"] > rows["high"], "the first row is at the bottom"
