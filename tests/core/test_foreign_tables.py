"""Names, units and numbers of tables that other tools wrote."""

import pytest

from core.foreign_tables import (
    allowed_odd,
    length_unit,
    separator_of,
    spelled,
    split_unit,
    time_unit,
    with_point,
    without_unit,
)


@pytest.mark.parametrize(
    ("word", "unit"),
    [
        ("us", "us"), ("µs", "us"), ("microseconds", "us"), ("Milliseconds", "ms"), ("msec", "ms"), ("s", "s"),
        ("second", "s"), ("nanoseconds", "ns"), ("m", None), ("minutes", None), ("", None),
    ],
)  # fmt: skip
def test_a_word_means_a_unit_of_time_or_none(word: str, unit: str | None) -> None:
    assert time_unit(word) == unit


@pytest.mark.parametrize(
    ("word", "unit"), [("Metres", "m"), ("meter", "m"), ("mm", "mm"), ("centimetres", "cm"), ("inch", None)]
)
def test_a_word_means_a_unit_of_length_or_none(word: str, unit: str | None) -> None:
    assert length_unit(word) == unit


@pytest.mark.parametrize("name", ["t_us", "T [µs]", "t (us)", '"t-us"', "# t_us", "t.us"])
def test_a_name_and_its_unit_are_told_in_every_spelling(name: str) -> None:
    assert spelled(name) == "t_us"
    assert split_unit(name, "t|time") == ("t", "us")
    assert without_unit(spelled(name)) == ("t", "us")


def test_a_unit_is_joined_to_a_name_only_where_that_is_asked() -> None:
    assert split_unit("tms", "t|time") is None
    assert split_unit("tms", "t|time", joined=True) == ("t", "ms")
    assert split_unit("time", "t|time", joined=True) == ("time", None)
    assert split_unit("x_ms", "t|time") is None
    assert without_unit("stamp") == ("stamp", None)


@pytest.mark.parametrize(
    ("text", "number"), [("1,5", "1.5"), ("-,5", "-.5"), ("1,5e3", "1.5e3"), ("1,234,567", "1,234,567"), (",", ",")]
)
def test_a_decimal_comma_becomes_a_point_and_other_texts_stay(text: str, number: str) -> None:
    assert with_point(text) == number


def test_columns_are_separated_by_a_comma_unless_the_first_line_has_none() -> None:
    assert [separator_of(text) for text in ("a,b\n1;2", "\na;b\n1,5;2", "a\tb", "a b")] == [",", ";", "\t", ","]


def test_a_few_odd_rows_are_allowed_and_of_many_one_in_a_hundred() -> None:
    assert (allowed_odd(5), allowed_odd(1000)) == (3, 10)
