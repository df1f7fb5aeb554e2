"""A page that the processor draws is drawn a few times a second while a rally runs, and as often as a hand asks."""

import pytest

from app.bench.live_pace import WINDOW
from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, join_simulation
from app.shared.simulation_process import SimulationProcess
from app.shared.workspace import Workspace

pytestmark = pytest.mark.browser
COUNT_FRAMES = """
window.frames_drawn = 0;
const clear = WebGL2RenderingContext.prototype.clear;
WebGL2RenderingContext.prototype.clear = function (...all) { window.frames_drawn++; return clear.apply(this, all); };
"""
SECONDS = 4


def drawn(page) -> float:
    """Frames a second."""
    page.evaluate("frames_drawn = 0")
    page.wait_for_timeout(1000 * SECONDS)
    return page.evaluate("frames_drawn") / SECONDS


def test_frames_keep_apart_unless_a_hand_is_at_work(chromium, tmp_path, wait_for) -> None:
    process = SimulationProcess("--auto-serve", "5", "--seed", "3")
    live = join_simulation(process.wait(), process=process)
    live.simulation.set_speed(0.5)
    workspace = Workspace(tmp_path)
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    page = chromium.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
    try:
        page.add_init_script(COUNT_FRAMES)
        page.goto(f"http://127.0.0.1:{lab.port}/?fixedDpr=1")
        page.wait_for_function("rallyscope.rallyRuns", timeout=150_000)
        page.wait_for_timeout(3000)
        assert page.evaluate("rallyscope.bySoftware")
        assert 1 <= drawn(page) <= 1000 / 180 + 0.5
        moved = "dispatchEvent(new PointerEvent('pointermove', { clientX: 600, clientY: 300 }))"
        page.evaluate(f"setInterval(() => {moved}, 50)")
        page.wait_for_timeout(500)
        page.evaluate("turns = 0; (function turn() { turns++; requestAnimationFrame(turn); })()")
        page.wait_for_timeout(1000 * SECONDS)
        assert page.evaluate("turns") / SECONDS > 1000 / 180 + 1
    finally:
        page.close()
        lab.stop()
