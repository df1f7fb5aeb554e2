import json

import pytest

from benchmarks.prediction.prediction_errors import LEADS_MS, PredictionErrors
from benchmarks.prediction.prediction_report import PerceivedFigures, draw_leads, write_prediction_report
from core.errors import RecordingError

METHODS = ("filter", "fit", "paper", "filter-auto")


def errors(value: float) -> PredictionErrors:
    found = PredictionErrors(
        landing_mm=[value], plane_mm=[value], time_ms=[value], seconds=[1e-4], quiet_seconds=[1e-5]
    )
    for lead in LEADS_MS[:3]:
        found.by_lead_mm[lead] = found.by_lead_ms[lead] = found.normalised[lead] = [value]
    found.nees = {"before landing": [0.9], "after bounce": [1.1]}
    return found


@pytest.fixture
def perceived() -> PerceivedFigures:
    rows = [
        {"speed_mps": speed, "method": method, "balls": 4, "point_median_mm": 3.0, "point_p95_mm": 9.0}
        | errors(7.0 + k).row()
        for speed in (5.0, "all")
        for k, method in enumerate(METHODS)
    ]
    return PerceivedFigures(
        rows, [{"method": m} | row for k, m in enumerate(METHODS) for row in errors(7.0 + k).leads()]
    )


@pytest.fixture
def exact(perceived) -> dict[str, object]:
    rows = [{"method": method} | errors(1.5).row() for method in ("filter", "paper")]
    leads = [{"method": method} | row for method in ("filter", "paper") for row in errors(1.5).leads()]
    return {"flights": 14, "rows": rows, "leads": leads}


def test_the_page_has_every_method_and_says_what_is_missing(perceived, exact, tmp_path) -> None:
    path = tmp_path / "docs" / "page.md"
    write_prediction_report(path, perceived, exact, tmp_path / "none.json", 5, {"cpu": "slow"})
    page = path.read_text()
    assert "4 balls" in page and "cpu slow" in page and "seed 5" in page
    assert "| 5.0 | filter | 4 | 7 / 7 | 7 / 7 | 7 / 7 |" in page
    assert "| 25 | 7 / 7 (7) | 8 / 8 (8) | 9 / 9 (9) | 10 / 10 (10) |" in page
    assert "| 400 | - / - (-) | - / - (-) | - / - (-) | - / - (-) |" in page
    assert "with its prediction 0.1 ms" in page and "0.9 80 ms before" in page
    assert "Recorded flights" not in page and "{" not in page
    assert (tmp_path / "docs" / "images" / "prediction-lead.svg").read_text().endswith("</svg>\n")


def test_recorded_flights_are_in_it_when_they_were_measured(perceived, exact, tmp_path) -> None:
    ahead = {"0.1": 12.0}
    row = {"bounce_median_mm": 80.0, "bounce_p95_mm": 150.0, "ahead_median_mm": ahead, "ahead_p95_mm": {"0.1": 70.0}}
    report = {
        "predictors": [{"method": "filter", "flights": {"0.1": 21}, "normalised_but_worst": {"0.1": 0.58}} | row],
        "test": [{"model": "gravity"} | row],
        "flights": {"fit": 49, "test": 21},
    }
    flights = tmp_path / "flights.json"
    flights.write_text(json.dumps(report))
    write_prediction_report(tmp_path / "page.md", perceived, exact, flights, 5, {})
    page = (tmp_path / "page.md").read_text()
    assert "| filter | 80 / 150 | 12 / 70 |" in page and "| gravity | 80 / 150 | 12 / 70 |" in page
    assert "100 ms ahead (21)" in page and "filter 0.58 at 100 ms" in page
    flights.write_text("[]")
    with pytest.raises(RecordingError, match=r"flights\.json"):
        write_prediction_report(tmp_path / "page.md", perceived, exact, flights, 5, {})


def test_the_chart_has_a_line_per_method_with_what_there_is(perceived, tmp_path) -> None:
    draw_leads(tmp_path / "leads.svg", perceived.leads)
    chart = (tmp_path / "leads.svg").read_text()
    assert all(f">{name}<" in chart for name in ("filter", "chain's fit", "paper's rule"))
    assert "mm along the plane" in chart and "ms before the ball is there" in chart
