"""Watch's left panel is narrow: its figures are no wider."""

from types import SimpleNamespace

from playwright.sync_api import Browser

from app.modes.watch.figures import figures_html, latency_rows
from core.live.live_snapshot import STAGES, stage_latencies
from tests.app.browser.window import open_page

PANEL_PX = 280
"""Width that the panel leaves to its figures in a window of 1280 px."""


def test_where_the_time_of_commands_goes_is_no_wider_than_the_panel(chromium: Browser) -> None:
    health = SimpleNamespace(stages=stage_latencies([tuple(1234.5 for _ in STAGES)]))  # ms, of a busy machine
    page = open_page(chromium, 640, 480)
    figures = figures_html(latency_rows(health))  # type: ignore[arg-type]
    panel = f"<div id=panel style='width:{PANEL_PX}px;overflow:auto;font-family:sans-serif'>{figures}</div>"
    page.set_content(f"<!DOCTYPE html>{panel}")
    wide = page.evaluate("document.querySelector('#panel').scrollWidth")
    page.close()
    assert wide == PANEL_PX
