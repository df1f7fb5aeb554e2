"""Where Label's small pictures stand, and how much of the middle is left to the large one."""

import pytest

from app.modes.label.label_picture import GAP_PX, LEAST_WIDTH_PX, MAIN_WIDTH_PX, choose_side_layout

RATIO = 9 / 16
BASE_PX = MAIN_WIDTH_PX * RATIO + 98


def share_of_large(pictures: int, aspect: float) -> float:
    """Share of a middle of this width over height that the large picture covers."""
    sides = choose_side_layout(pictures, RATIO, BASE_PX, aspect)
    width, height = float(MAIN_WIDTH_PX), BASE_PX
    if sides.beside:
        width += GAP_PX + sides.width_px
    else:
        height += -(-pictures // sides.columns) * (sides.width_px * RATIO + GAP_PX)
    scale = min(aspect / width, 1 / height)
    return MAIN_WIDTH_PX * MAIN_WIDTH_PX * RATIO * scale**2 / aspect


@pytest.mark.parametrize("pictures", [1, 2, 4])
@pytest.mark.parametrize("aspect", [1.1, 1.37, 1.52, 1.9, 2.4])
def test_the_large_picture_takes_most_of_the_middle(pictures: int, aspect: float) -> None:
    assert share_of_large(pictures, aspect) > 0.55


def test_in_a_wide_window_the_small_pictures_stand_beside_the_large_one() -> None:
    assert choose_side_layout(2, RATIO, BASE_PX, 2.2).beside
    assert not choose_side_layout(2, RATIO, BASE_PX, 1.3).beside


def test_what_the_large_picture_cannot_use_goes_to_the_small_ones() -> None:
    assert choose_side_layout(2, RATIO, BASE_PX, 1.37).width_px == LEAST_WIDTH_PX
    assert choose_side_layout(2, RATIO, BASE_PX, 1.0).width_px > 1.5 * LEAST_WIDTH_PX
    beside = choose_side_layout(2, RATIO, BASE_PX, 2.1)
    assert beside.width_px > LEAST_WIDTH_PX
    assert 2 * beside.width_px * RATIO + GAP_PX <= BASE_PX + 2
