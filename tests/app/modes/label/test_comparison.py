"""One's own labels beside somebody else's: counts, conflicts and what is settled, without files or a browser."""

import pytest

from app.modes.label.comparison import (
    LARGEST_PX,
    LabelComparison,
    LabelsOf,
    apart_px,
    compare_labels,
    pair_legend,
    pair_marks,
)
from app.modes.label.label_picture import CircleMark
from app.modes.label.merge_panel import counts_html, pair_html
from app.pictures.palette import PaletteIndex
from labels.arrays import label_arrays
from labels.conflicts import Settled, settlement
from labels.model import Label, LabelState, PositionSource, Provenance

DURATION_US = 1_000


def ball(t_us: int, x: float, *, made_at_us: int = 5, over: Label | None = None, how: Settled = "mean") -> Label:
    made = Provenance(made_at_us=made_at_us)
    if over is not None:
        made = Provenance(made_at_us=9, source=PositionSource.SETTLED, detector=settlement("bea", over, how))
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=0.0, r_px=5.0, provenance=made)


def nothing(t_us: int) -> Label:
    return Label(t_us=t_us, state=LabelState.NO_BALL, provenance=Provenance(made_at_us=5))


def of(annotator: str, *labels: Label) -> LabelsOf:
    return LabelsOf(annotator, {label.t_us: label for label in labels}, label_arrays(labels))


@pytest.fixture
def compared() -> LabelComparison:
    theirs = [ball(20, 50.0), ball(30, 30.0), nothing(40), ball(50, 50.0), ball(70, 1.0), ball(DURATION_US, 1.0)]
    mine = [
        ball(10, 10.0),
        ball(20, 10.0),
        ball(30, 31.0),
        ball(40, 1.0),
        ball(50, 50.0, over=theirs[3], how="theirs"),
        ball(60, 1.0),
    ]
    return compare_labels("left", "bea", of("anna", *mine), of("bea", *theirs), DURATION_US)


def test_every_time_is_counted_once(compared: LabelComparison) -> None:
    assert compared.agreed == 1 and compared.open_us.tolist() == [20, 40] and compared.resolved_us.tolist() == [50]
    assert compared.only_mine == 2
    assert compared.only_theirs_us.tolist() == [70], "what is behind the end of the recording cannot be looked at"
    text = counts_html(compared)
    assert "1 of 3 settled" in text and "1 agree" in text and "2 only yours, 1 only bea's" in text


def test_conflicts_are_gone_through_in_both_directions_and_round_once(compared: LabelComparison) -> None:
    assert [compared.next_open(t_us, +1) for t_us in (0, 20, 39, 40)] == [20, 40, 40, 20]
    assert [compared.next_open(t_us, -1) for t_us in (100, 40, 21, 20)] == [40, 20, 20, 40]
    left = compared.resolved_at(20).resolved_at(40)
    assert left.next_open(0, +1) is None and left.resolved_us.tolist() == [20, 40, 50]
    assert left.resolved_at(20) is left and compared.open_us.tolist() == [20, 40]


def test_the_other_label_is_seen_where_it_matters_and_nowhere_else(compared: LabelComparison) -> None:
    mine = compared.mine.labels
    beside = {t_us: compared.theirs_beside(t_us, mine.get(t_us)) for t_us in range(0, 80, 10)}
    assert [t_us for t_us, label in beside.items() if label is not None] == [20, 40, 50, 70]


def test_both_labels_are_drawn_and_named_each_in_its_colour(compared: LabelComparison) -> None:
    mine, theirs = compared.mine.labels[20], compared.theirs.labels[20]
    assert pair_marks(mine, theirs) == (
        CircleMark(10.0, 0.0, 5.0, PaletteIndex.MINE),
        CircleMark(50.0, 0.0, 5.0, PaletteIndex.THEIRS),
    )
    assert pair_legend(("anna", mine), ("bea", nothing(1))) == (
        ("anna: visible, r 5.00 px", PaletteIndex.MINE),
        ("bea: no ball", PaletteIndex.THEIRS),
    )
    assert apart_px(mine, theirs) == 40.0 and apart_px(mine, nothing(1)) is None
    text = pair_html(compared, 20, mine)
    assert "40.00 px apart" in text and "anna: visible" in text and "settled" not in text
    assert "settled: theirs was taken" in pair_html(compared, 50, compared.mine.labels[50])
    assert "no conflict here" in pair_html(compared, 10, compared.mine.labels[10])
    assert "unchecked" in pair_html(compared, 70, None)


def test_a_hostile_name_and_an_endless_radius_are_only_text_and_a_large_circle(compared: LabelComparison) -> None:
    huge = Label(t_us=20, state=LabelState.VISIBLE, x_px=1e300, y_px=0.0, r_px=1e300)
    odd = compare_labels("left", "x", of("anna", ball(20, 1.0)), of("<b>\x1b\u202e" + "x" * 500, huge), DURATION_US)
    text = pair_html(odd, 20, odd.mine.labels[20]) + counts_html(odd)
    assert "<b>\\" not in text and "\x1b" not in text and "\u202e" not in text and len(text) < 2_000
    assert pair_marks(None, huge) == (CircleMark(1e300, 0.0, LARGEST_PX, PaletteIndex.THEIRS),)
