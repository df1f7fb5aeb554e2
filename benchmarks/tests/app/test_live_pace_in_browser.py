"""`bench app --only pace` in a browser, shortly."""

import pytest

from benchmarks.app import live_pace

pytestmark = pytest.mark.browser


def test_a_short_run_has_all_figures(chromium, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(live_pace, "SETTLE_S", 0.0)
    pace, slowest, median, tail = live_pace.measure_in(chromium, tmp_path, runs=1, seconds=5.0)
    assert pace["measured"] > 0 and 0 < median["measured"] <= tail["measured"]
    assert slowest["what"] == "its slowest second with a ball"
