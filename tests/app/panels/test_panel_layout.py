"""The middle of the window is never a slit, at the sizes that are promised."""

import pytest

from app.panels.recording_info import WIDTHS_PX, Room, room_beside
from app.theme import PANEL_WIDTH_PX

RAIL_PX = 40


def middle_px(width_px: int, room: Room) -> int:
    return width_px - PANEL_WIDTH_PX - 8 - (RAIL_PX if room == "folded" else WIDTHS_PX[room])


@pytest.mark.parametrize(
    ("size", "room"),
    [
        ((1000, 700), "folded"),
        ((1280, 720), "narrow"),
        ((1600, 900), "wide"),
        ((1920, 1080), "wide"),
    ],
)
def test_the_panel_settles_and_leaves_45_percent_to_the_scene(size, room) -> None:
    width_px, height_px = size
    for start in ("folded", "narrow", "wide"):
        now: Room = start
        for _ in range(4):
            now = room_beside(middle_px(width_px, now) / height_px, now)
        assert room_beside(middle_px(width_px, now) / height_px, now) == now, "no to and fro"
        assert middle_px(width_px, now) >= 0.45 * width_px
        if start == "narrow":
            assert now == room


def test_a_folded_panel_that_a_person_opens_stays_open() -> None:
    assert room_beside(0.4, "folded") == "folded", "nothing is sent"
