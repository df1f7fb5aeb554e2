"""The charts of the reports."""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from benchmarks.charts import ChartLine, CirclePanel, circle_panels, line_chart
from core.errors import RallyscopeError
from core.metrics.charts import heat_map

TEXT = "{http://www.w3.org/2000/svg}text"
NAN = float("nan")


def texts(path: Path) -> list[str]:
    return [str(element.text) for element in ElementTree.parse(path).iter(TEXT)]


def test_every_cell_says_its_share_and_of_how_many_and_an_empty_one_says_nothing(tmp_path: Path) -> None:
    shares, counts = np.array([[0.25, 1.0], [0.0, 0.0]]), np.array([[4, 1200], [7, 0]])
    path = tmp_path / "a.svg"
    heat_map(path, "A < B", "speed, m/s", "spin", ["1", "2"], ["low", "high"], shares, counts)
    found = texts(path)
    assert {"A < B", "speed, m/s", "spin", "1", "2", "low", "high"} <= set(found)
    assert [text for text in found if text.endswith("%")] == ["25 %", "100 %", "0 %"]
    assert "of 1,200" in found and "of 0" not in found
    assert found.index("low") < found.index("high"), "the first row is at the bottom"


def test_a_chart_names_its_lines_and_axes_and_is_well_formed_without_any(tmp_path: Path) -> None:
    line_chart(tmp_path / "none.svg", "a < b", "episode", "error, mm", [])
    assert {"a < b", "episode", "error, mm"} <= set(texts(tmp_path / "none.svg"))
    line = ChartLine("c & d", [0, 1, 2], [1.0, NAN, 3.0], [0.5, NAN, 2.0], [1.5, NAN, 4.0])
    line_chart(tmp_path / "images" / "one.svg", "t", "x", "y", [line, line], y_top=2.0)
    assert texts(tmp_path / "images" / "one.svg").count("c & d") == 2


def test_the_same_chart_is_the_same_file(tmp_path: Path) -> None:
    for name in ("a", "b"):
        line_chart(tmp_path / name, "t", "x", "y", [ChartLine("c", [0, 1], [1, 2], [0, 1], [2, 3])], y_top=3.0)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert b"<dc:date>" not in (tmp_path / "a").read_bytes()


def test_without_matplotlib_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(RallyscopeError, match=r"pip install 'rallyscope\[bench\]'"):
        line_chart(tmp_path / "a.svg", "t", "x", "y", [])
    assert not list(tmp_path.iterdir())


def test_panels_show_the_events_the_truth_and_the_answer() -> None:
    on, off = np.array([[105.0, 50.0]]), np.array([[95.0, 50.0], [95.0, 51.0]])
    panel = CirclePanel("a < b\nno answer", on, off, (100.0, 50.0, 8.0), None)
    answered = CirclePanel("c", on, off, (100.0, 50.0, 8.0), (101.0, 50.0, 8.0))
    png = circle_panels([panel, answered], half_px=20.0)
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    halves = image[:, : image.shape[1] // 2].astype(int), image[:, image.shape[1] // 2 :].astype(int)
    for half in halves:
        blue, _, red = half.transpose(2, 0, 1)
        assert 1.3 < (blue > red + 50).sum() / (red > blue + 50).sum() < 3.5, "two OFF events, one ON"
    green = [(half[:, :, 1] > half[:, :, [0, 2]].max(axis=2) + 40).sum() for half in halves]
    assert green[0] == 0 < green[1], "only one has an answer"
    assert png == circle_panels([panel, answered], half_px=20.0), "the same panels are the same file"
