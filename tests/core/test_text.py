"""Tables of pages, and counts in words."""

import pytest

from core.text import counted, markdown_table


def test_numbers_are_written_as_their_column_asks_and_stand_on_the_right() -> None:
    rows = [["a", 1234, 0.25, "x"], ["b", None, 2.0, 7]]
    assert markdown_table(["name", "count", "share", "rest"], rows, ("", ",", ".1f")).splitlines() == [
        "| name | count | share | rest |",
        "| --- | ---: | ---: | --- |",
        "| a | 1,234 | 0.2 | x |",
        "| b | - | 2.0 | 7 |",
    ]


def test_a_table_without_rows_has_its_titles() -> None:
    assert markdown_table(("a", ""), []) == "| a |  |\n| --- | --- |\n"


@pytest.mark.parametrize(
    ("count", "thing", "text"),
    [
        (0, "label", "0 labels"), (1, "label", "1 label"), (1260, "event", "1,260 events"), (2, "launch", "2 launches"),
        (3, "miss", "3 misses"), (1, "box", "1 box"), (2, "box", "2 boxes"), (2, "earlier window", "2 earlier windows"),
    ],
)  # fmt: skip
def test_a_count_and_its_thing_agree(count: int, thing: str, text: str) -> None:
    assert counted(count, thing) == text
