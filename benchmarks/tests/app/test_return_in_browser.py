"""`bench app --only return` in a browser, shortly."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from benchmarks.app.bench_app import GOAL_S, measure_in

pytestmark = pytest.mark.browser


def test_a_page_with_the_focus_and_one_behind_another_are_back_after_the_server_was_killed(
    chromium: Browser, tmp_path: Path
) -> None:
    row = measure_in(chromium, tmp_path, turns=2)
    assert row["measured"] > 0 and row["met"] == (row["measured"] <= GOAL_S)
