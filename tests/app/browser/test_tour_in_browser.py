"""The guided tour in a real browser: each card stands beside what it speaks of."""

from app.client_session.tour import PICTURE, TOURS
from app.state.client_state import MODES
from app.state.commands import SetMode
from tests.waiting import eventually

BOXES = """() => ["#rallyscope-tour", "#rallyscope-tour-frame"].map((name) => {
  const found = document.querySelector(name), box = found.getBoundingClientRect();
  return found.hidden ? null : [box.left, box.top, box.right, box.bottom];
})"""


def apart(one: list[float], other: list[float]) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


def test_it_leads_through_every_mode_beside_what_it_speaks_of(lab, open_window) -> None:
    with open_window(lab, first_time=True) as window:
        page, card = window.page, window.page.locator("#rallyscope-tour")
        for mode in MODES:
            window.session.send(SetMode(mode))
            for number, step in enumerate(TOURS[mode]):
                card.get_by_text(f"{mode}, {number + 1} of {len(TOURS[mode])}").wait_for()
                eventually(lambda: page.evaluate(BOXES)[1] is not None, f"{mode}: {step.at} to be framed")
                page.wait_for_function("document.activeElement.dataset.do === 'next'")
                window.screenshot(f"tour-{mode}-{number + 1}")
                place, frame = page.evaluate(BOXES)
                assert place[0] >= 0 and place[1] >= 0 and place[2] <= 1280 and place[3] <= 720, (mode, step)
                assert step.at == PICTURE or apart(place, frame), f"{mode}: the card covers {step.at}"
                page.keyboard.press("Enter")
            card.wait_for(state="hidden")
        eventually(lambda: {f"tour of {mode}" for mode in MODES} <= window.session.page.seen, "it to be kept")
        window.session.send(SetMode("Tune"))
        eventually(lambda: window.session._tour._mode == "Tune", "Tune again")
        assert not card.is_visible()
        page.get_by_role("button", name="Show the tour").first.click()
        card.get_by_text("Tune, 1 of").wait_for()
        page.get_by_role("button", name="Skip tour").click()
        card.wait_for(state="hidden")
