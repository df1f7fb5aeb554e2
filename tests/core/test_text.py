"""Tables of pages."""

from core.text import markdown_table


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
