"""A scripted person labels through the screen and the keyboard, survives a kill of the server, exports and scores."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from benchmarks.app.label_user import label_with_browser

pytestmark = pytest.mark.browser
COUNT = 14


@pytest.mark.timeout(1800)  # two cold servers and a simulation, on a machine that other tests use as well
def test_what_the_screen_calls_saved_survives_a_kill_and_comes_back_from_every_format(
    tmp_path: Path, chromium: Browser
) -> None:
    result = label_with_browser(tmp_path, COUNT, browser=chromium)
    assert result.labels >= COUNT and result.before_kill >= COUNT // 2 and result.lost == 0
    assert result.clicked >= 1 and result.accepted > result.clicked
    assert result.median_error_px < 0.3
    assert result.formats_failed == 0, result.formats
    assert "voc by LabelImg" in result.formats and "coco by pycocotools" in result.formats
    assert result.scored_labels == result.labels
