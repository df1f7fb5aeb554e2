"""Whether all words on the page can be read: WCAG's contrast of every visible text with what is behind it, and hints
that cover nothing."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator

from app.state.client_state import MODES
from tests.waiting import eventually

LEAST = 4.5
"""WCAG 2.2, 1.4.3 (AA), for text of any size here."""
CONTRASTS = r"""() => {
  const scratch = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const parsed = new Map();
  const rgba = (css) => {
    if (parsed.has(css)) return parsed.get(css);
    const numbers = css.match(/^rgba?\(([^)]+)\)$/)?.[1].split(",").map(Number);
    let colour = numbers && [numbers[0], numbers[1], numbers[2], numbers[3] ?? 1];
    if (!colour) { // any other way to write one
      scratch.clearRect(0, 0, 1, 1);
      scratch.fillStyle = css;
      scratch.fillRect(0, 0, 1, 1);
      const [red, green, blue, alpha] = scratch.getImageData(0, 0, 1, 1).data;
      colour = [red, green, blue, alpha / 255];
    }
    parsed.set(css, colour);
    return colour;
  };
  const over = (top, below) => [0, 1, 2].map((k) => top[3] * top[k] + (1 - top[3]) * below[k]);
  const light = (rgb) => {
    const [r, g, b] = rgb.map((c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (one, other) => {
    const [low, high] = [light(one), light(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  const page = [22, 24, 29]; // of the pictures, on which words may stand
  const behind = (element) => { // backgrounds from the element outwards, until one hides the others
    const layers = [];
    for (let at = element; at; at = at.parentElement) {
      const colour = rgba(getComputedStyle(at).backgroundColor);
      if (colour[3] > 0) layers.push(colour);
      if (colour[3] === 1) break;
    }
    return layers.reduceRight((below, layer) => over(layer, below), page);
  };
  const opacity = (element) => {
    let all = 1;
    for (let at = element; at; at = at.parentElement) all *= Number(getComputedStyle(at).opacity);
    return all;
  };
  const isSeen = (element) => element.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  const isStale = document.documentElement.hasAttribute("data-rallyscope-stale");
  const isOff = (element) => // what cannot be used, and what is outdated and therefore grey, may be faint
    element.closest(":disabled, [data-disabled], [aria-disabled=true], [inert]") ||
    (isStale && element.closest(".rallyscope-answer, #rallyscope-texts"));
  const found = [];
  const judge = (element, text, css) => {
    if (!text.trim() || !isSeen(element) || isOff(element)) return;
    const below = behind(element), [red, green, blue, alpha] = rgba(css);
    const shown = over([red, green, blue, alpha * opacity(element)], below);
    found.push([ratio(shown, below), text.trim().slice(0, 60), css, below.map(Math.round).join(" ")]);
  };
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const element = texts.currentNode.parentElement;
    if (element.closest("script, style, noscript, canvas")) continue;
    const look = getComputedStyle(element);
    judge(element, texts.currentNode.nodeValue, element instanceof SVGElement ? look.fill : look.color);
  }
  const fields = "input:not([type=checkbox], [type=file], [type=hidden]), textarea, select";
  for (const field of document.querySelectorAll(fields)) {
    const pseudo = field.value || !field.placeholder ? undefined : "::placeholder";
    judge(field, field.value || field.placeholder || "", getComputedStyle(field, pseudo).color);
  }
  return found;
}"""
"""[contrast, text, its colour, the colour behind it] of each visible text and of what stands in fields."""


def places(window) -> Iterator[str]:
    """Lead through the page, and name each place where all that is shown is to be read."""
    page = window.page
    page.get_by_role("button", name="Show the tour").first.click()
    page.locator("#rallyscope-tour").wait_for()
    yield "the tour"
    page.keyboard.press("Escape")
    page.locator("#rallyscope-tour").wait_for(state="hidden")
    for mode in MODES:
        if window.state.mode != mode:
            window.enter(mode)
        for folder in page.locator("#root .tabler-icon-chevron-down:visible").all()[:12]:
            if folder.is_visible():
                folder.click()
        yield mode
        tabs = page.locator("[data-rallyscope-lower] [data-dock-tab]:visible")
        for number in range(tabs.count()):
            tabs.nth(number).click()
            yield f"{mode}, {tabs.nth(number).inner_text()}"
    page.keyboard.press("Control+o")
    page.locator("#rallyscope-files[open]").wait_for()
    yield "the file dialog"
    page.keyboard.press("Escape")
    window.session.later(lambda: window.session.note("A title", "What has happened.", "red"))
    page.get_by_text("What has happened.").wait_for()
    window.session.later(lambda: window.session.say("A line that goes away by itself"))
    page.get_by_text("A line that goes away by itself").wait_for()
    yield "messages"


def test_all_words_can_be_read(window) -> None:
    faint: set[tuple[str, ...]] = set()
    window.seek(300_000)
    for place in places(window):
        window.wait_for_frame()
        found = window.page.evaluate(CONTRASTS)
        assert len(found) > 20, f"words in {place}"
        faint |= {(place, f"{ratio:.2f}", *rest) for ratio, *rest in found if ratio < LEAST}
    assert not faint, "\n".join(map(" | ".join, sorted(faint)))
    probe = "<p style='color: #777; background: rgb(22, 24, 29)'>too faint</p>"
    window.page.evaluate("html => document.body.insertAdjacentHTML('beforeend', html)", probe)
    (ratio,) = (ratio for ratio, text, *_ in window.page.evaluate(CONTRASTS) if text == "too faint")
    assert ratio == pytest.approx(3.97, abs=0.02), "what is faint would have been found"


HINT = "[class*=mantine-Tooltip-tooltip]"


def box_of(found: Locator) -> tuple[float, float, float, float]:
    """Left, top, right, bottom, CSS px; all 0 of what is not there."""
    box = found.bounding_box() or {"x": 0, "y": 0, "width": 0, "height": 0}
    return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]


def a_hint_stands_beside_the_panel_and_goes_with_a_click(window) -> None:
    page, box = window.page, window.page.get_by_label("Compare A and B")
    hint = page.locator(HINT)
    panel = box_of(page.locator("[data-dock-region]").filter(has=box).last)
    box.hover()
    hint.wait_for()
    eventually(lambda: box_of(hint)[2] <= panel[0], "the hint beside the panel", lambda: (box_of(hint), panel))
    assert hint.inner_text() == "Both configs on the same window" and box_of(hint)[2] > 0
    page.mouse.down()
    hint.wait_for(state="hidden")
    page.mouse.up()
    eventually(lambda: window.state.tune.compare, "the click to count")
    window.wait_for_frame()
    assert hint.is_hidden(), "nor does it come back while the mouse rests"
    page.keyboard.press("z")


def the_button_of_the_tour_does_not_keep_the_keyboard(window) -> None:
    page, card = window.page, window.page.locator("#rallyscope-tour")
    page.get_by_role("button", name="Show the tour").first.click()
    card.wait_for()
    page.keyboard.press("Escape")
    card.wait_for(state="hidden")
    page.keyboard.press("Space")
    eventually(lambda: window.state.playhead.playing, "Space to play")
    assert card.is_hidden()


def test_hints_cover_nothing_and_the_keyboard_is_free_after_the_tour(window) -> None:
    window.enter("Tune")
    a_hint_stands_beside_the_panel_and_goes_with_a_click(window)
    the_button_of_the_tour_does_not_keep_the_keyboard(window)
