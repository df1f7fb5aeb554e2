"""The door and the page as a browser sees them: foreign pages, a reload, a server that is gone and comes back."""

import functools
import http.server
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from app.state.client_state import MODES
from app.state.commands import EditSetting, LookAt, SetMode, SetOverlay, SetZoom, StopAt
from benchmarks.app.bench_app import measure_in
from tests.app.browser.window import FEW_FRAMES, NEXT_FRAME, Window, open_page, save_screenshot
from tests.waiting import eventually

EVIL = b"""<!doctype html><title>evil</title><iframe id=frame></iframe><script>
const tried = {};
const port = new URLSearchParams(location.search).get("port");
for (const host of ["127.0.0.1", "localhost"]) {
  for (const path of ["/", "/rallyscope/page?page=x"]) {
    const socket = new WebSocket(`ws://${host}:${port}${path}`, path === "/" ? ["viser-v1.1.1"] : []);
    const name = host + path;
    socket.onopen = () => { tried[name] = "open"; };
    socket.onclose = () => { tried[name] = tried[name] || "closed"; };
  }
}
fetch(`http://127.0.0.1:${port}/`).then(one => one.text()).then(
  text => { tried.fetch = text.includes("Rallyscope") ? "read" : "other"; }, () => { tried.fetch = "closed"; });
document.getElementById("frame").onload = () => { window.framed = true; };
document.getElementById("frame").src = `http://127.0.0.1:${port}/`;
window.tried = tried;
</script>"""

NOTE_PICTURES = """
window.pictures = [];
const plain = WebGL2RenderingContext.prototype.texImage2D, part = WebGL2RenderingContext.prototype.texSubImage2D;
for (const [name, draw] of [["texImage2D", plain], ["texSubImage2D", part]])
  WebGL2RenderingContext.prototype[name] = function (...given) {
    pictures.push(given[given.length - 1]?.constructor?.name);
    return draw.apply(this, given);
  };
"""
"""Of what kind everything is that is given to the graphics driver."""
NOTE_SKIES = """
window.skies = [];
const plainFetch = window.fetch;
let load = plainFetch;
Object.defineProperty(window, "fetch", { get: () => load, set: (other) => {
  load = (source, ...more) => {
    const answer = other.call(window, source, ...more);
    const url = source.url ?? String(source);
    if (url.startsWith("data:image/jpeg")) {
      const sky = { url, given: false };
      answer.then(() => { sky.given = true; });
      skies.push(sky);
    }
    return answer;
  };
}});
window.skyCouldBeThere = async () => { await createImageBitmap(await (await plainFetch(skies[0].url)).blob()); };
"""
"""Skies that viser asks for, and whether it was given them."""


class EvilPage(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(EVIL)

    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def evil_port() -> Iterator[int]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), EvilPage)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address[1]
    server.shutdown()
    server.server_close()


def test_a_page_of_another_origin_reaches_nothing(chromium: Browser, lab, evil_port: int) -> None:
    before = set(lab.sessions)
    page = open_page(chromium)
    page.goto(f"http://127.0.0.1:{evil_port}/?port={lab.port}")
    eventually(lambda: len(page.evaluate("Object.keys(tried)")) == 5, "all five ways to be tried")
    tried = page.evaluate("tried")
    assert set(tried.values()) == {"closed"}, tried
    page.wait_for_function("window.framed")  # with what the browser shows instead
    assert page.frames[1].locator("#root").count() == 0, "our page stands in a frame of another's"
    assert set(lab.sessions) == before
    page.close()


@pytest.mark.gate
def test_a_reload_keeps_what_was_looked_at_and_a_colleague_with_the_link_sees_it(chromium: Browser, lab) -> None:
    page = open_page(chromium)
    window = Window(page, lab)
    session = window.session
    for command in (
        SetMode("Tune"),
        StopAt(150_000),
        SetOverlay("clusters"),
        SetZoom(4.0),
        LookAt((300.0, 200.0)),
        EditSetting(("cluster", "eps_px"), 5.0),
    ):
        session.send(command)
    eventually(lambda: "zoom=4" in address(page) and "a.cluster.eps_px=5.0" in address(page), "the address to show it")
    kept = window.state
    eventually(lambda: is_stored(lab, session), "the settings to be stored: nothing waits for that at a reload")
    session = reloaded(page, lab, session)
    again = session.state
    assert again.mode == "Tune" and again.playhead.position_us(time.monotonic()) == 150_000
    assert again.tune == kept.tune and again.history.present == kept.history.present
    assert again.history.undo().present.a.cluster.eps_px == kept.history.undo().present.a.cluster.eps_px != 5.0
    a_colleague_who_opens_the_link_sees_the_same(chromium, lab, page, session)
    page.close()


def test_label_has_its_zoom_again_after_a_reload(chromium: Browser, lab) -> None:
    page = open_page(chromium)
    session = Window(page, lab).session
    session.send(SetMode("Label"))
    eventually(lambda: session._modes["Label"]._editor, "Label to be open")
    session.later(lambda: session._modes["Label"]._act("zoom_2"))
    eventually(lambda: "label_zoom=10" in address(page), "the address to have it")
    again = reloaded(page, lab, session)._modes["Label"]
    eventually(lambda: again._editor is not None and again._editor.labelling.view.zoom == 10.0, "the zoom to be back")
    page.close()


def is_stored(lab, session) -> bool:
    """Whether the settings of the browser are on the disk."""
    stored = lab.services.browsers.recall(session.page._visit.browser)
    return stored is not None and stored.configs == session.state.configs


def reloaded(page: Page, lab, before):
    """The session that comes after a reload, with its state."""
    known = set(lab.sessions)
    page.reload()
    (session,) = eventually(lambda: set(lab.sessions) - known, "the page to connect again")
    eventually(lambda: session.state is not None and session.state.mode == before.state.mode, "the state to be back")
    return session


def a_colleague_who_opens_the_link_sees_the_same(chromium: Browser, lab, mine: Page, session) -> None:
    for command in (StopAt(120_000), EditSetting(("cluster", "eps_px"), 6.0)):
        session.send(command)
    eventually(lambda: "a.cluster.eps_px=6.0" in address(mine), "the address to show it")
    known = set(lab.sessions)
    other = open_page(chromium)  # another browser: no cookie of the first
    other.add_init_script(FEW_FRAMES)
    other.goto(address(mine))
    (session,) = eventually(lambda: set(lab.sessions) - known, "the colleague to connect")
    eventually(lambda: session.state is not None and session.state.mode == "Tune", "the link to be followed")
    assert session.state is not None and session.state.config.cluster.eps_px == 6.0
    assert session.state.playhead.position_us(time.monotonic()) == 120_000
    other.close()


@pytest.mark.gate
def test_a_server_that_is_killed_and_started_again_has_the_open_page_back(chromium: Browser, tmp_path: Path) -> None:
    row = measure_in(chromium, tmp_path, turns=1)  # returns once the page shows its mode and its recording again
    assert row["measured"] > 0


def address(page: Page) -> str:
    return page.evaluate("location.href")


NOTE = "[class*=mantine-Notification-root]"
CLICKS_AFTER_A_NOTE = """async (text) => {
  const canvas = document.querySelector("#root canvas"), heard = [];
  const note = () => [...document.querySelectorAll("[class*=mantine-Notification-root]")].find(
    (one) => one.textContent.includes(text));
  const wait = (ms) => new Promise(act => setTimeout(act, ms));
  let at = null;
  const click = () => canvas.dispatchEvent(new PointerEvent("pointerdown", at));
  canvas.addEventListener("pointerdown", () => heard.push("heard"));
  const now_ms = performance.now();
  performance.now = () => now_ms;  // however slow the page is, no time passes between note and click
  await wait(300);  // longer than from one look at the notes to the next, and timers end in order
  const box = note().getBoundingClientRect();
  at = { bubbles: true, cancelable: true, clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 };
  note().querySelector("button").click();
  while (note()) await wait(20);
  click();
  const at_once = heard.length;
  performance.now = () => now_ms + 1600;
  click();
  delete performance.now;
  return [at_once, heard.length];
}"""
"""Clicks where a note was: when it has just gone, and later."""


def a_click_on_a_note_that_has_just_gone_is_not_one_on_the_picture(window) -> None:
    # The windows of these tests let clicks through; a note that does was never clicked on.
    window.page.add_style_tag(content=f"{NOTE} {{ pointer-events: auto !important; }}")
    text = "It lies over the picture."
    window.session.later(lambda: window.session.note("Mind", text, "yellow"))
    window.wait_until_at_rest(window.page.get_by_text(text))  # it slides in
    assert window.page.evaluate(CLICKS_AFTER_A_NOTE, text) == [0, 1]


def a_panel_below_the_picture_leaves_the_controls_free(window) -> None:
    page = window.page
    page.get_by_text("Health").first.wait_for()

    def right_of(selector: str) -> float:
        return page.locator(selector).last.evaluate("one => one.getBoundingClientRect().right")

    panel = "[class*=mantine-Paper-root][style*='position: absolute']"
    for width in (1280, 1000):
        page.set_viewport_size({"width": width, "height": 720})
        eventually(lambda: right_of("#root canvas") < page.viewport_size["width"] - 300, "room for the controls")
        eventually(lambda: right_of(panel) <= right_of("#root canvas"), f"the panel to fit a window of {width} px")


def test_a_panel_leaves_the_controls_free_and_a_note_that_has_gone_takes_its_click(window) -> None:
    a_click_on_a_note_that_has_just_gone_is_not_one_on_the_picture(window)
    a_panel_below_the_picture_leaves_the_controls_free(window)


COVERED = """title => {
    const box = one => one.getBoundingClientRect();
    const notes = [...document.querySelectorAll("[class*=mantine-Notification-root]")];
    const note = notes.find(one => one.textContent.includes(title));
    if (!note) return "no note";
    const a = box(note), canvas = box(document.querySelector("#root canvas"));
    if (a.left < canvas.left || a.right > canvas.right || a.top < 0) return "the note is beside the picture";
    const others = [...document.querySelectorAll("#rallyscope-bar, #root [role=tab], #rallyscope-texts span")];
    return others.filter(one => one.offsetParent !== null || one.id).map(one => [one.textContent, box(one)])
        .filter(([, b]) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom)
        .map(([text]) => text).join("; ");
}"""


@pytest.mark.parametrize("size", [(1280, 720), (1000, 700)])
def test_a_note_covers_no_caption_nor_bar_nor_panel_in_any_mode(window, size, monkeypatch) -> None:
    page = window.page
    monkeypatch.setattr("app.session.NOTE_SECONDS", 120.0)  # not gone before a slow page is looked at
    page.set_viewport_size({"width": size[0], "height": size[1]})
    window.screenshot("front-note-before")  # takes away the note of the browser about its graphics
    for mode in MODES:
        window.session.send(SetMode(mode))
        eventually(lambda mode=mode: window.state.mode == mode, mode)
        window.wait_until_still()
        title = f"A note in {mode}"
        note = functools.partial(window.session.note, title, "of two lines: where does it stand?", "green")
        window.session.later(note)
        page.get_by_text(title).first.wait_for()
        covers = functools.partial(page.evaluate, COVERED, title)
        eventually(lambda covers=covers: covers() == "", f"{title} to have slid to where it covers nothing")
        save_screenshot(page, f"front-note-{mode}-{size[0]}")
        page.evaluate(f"document.querySelectorAll('{NOTE}').forEach(note => note.style.display = 'none')")


def test_the_page_draws_our_pictures_and_never_the_sky_of_viser(chromium: Browser, lab) -> None:
    page = open_page(chromium)
    page.add_init_script(NOTE_PICTURES)
    page.add_init_script(NOTE_SKIES)
    page.goto(f"http://127.0.0.1:{lab.port}/")
    page.wait_for_function("pictures.includes('HTMLImageElement')")
    page.wait_for_function("skies.length > 0")
    page.evaluate("skyCouldBeThere()")
    page.evaluate(NEXT_FRAME)
    drawn, skies = page.evaluate("[pictures, skies]")
    page.close()
    assert not any(sky["given"] for sky in skies)
    assert "ImageBitmap" not in drawn, "the sky is the only one"
