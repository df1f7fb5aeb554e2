"""How soon the page shows what it is asked for, with small counts."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from benchmarks.app.page_speed import measure_in


@pytest.mark.browser
@pytest.mark.timeout(1800)
def test_every_figure_of_the_page_is_measured(chromium: Browser, tmp_path: Path) -> None:
    rows = measure_in(chromium, tmp_path, events=1_000_000, starts=1, slides=5, seconds=4.0, live_s=2.0)
    assert len(rows) == 7
    for row in rows:
        value = row["measured"]
        assert isinstance(value, float) and value > 0, row
