"""Tables of the pages that we write."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[object]], formats: Sequence[str] = ()) -> str:
    """Rows as a Markdown table that ends with a line break.

    A cell is text or a number, which is written as its column's format asks (",", ".3f"; none for "" and for columns
    beyond the last one); None is "-". Columns with a format are aligned to the right.
    """
    asked = [*formats, *[""] * (len(titles) - len(formats))]
    marks = ["---:" if form else "---" for form in asked]
    cells = (
        ["-" if value is None else value if isinstance(value, str) else format(value, form) for value, form in pairs]
        for pairs in (zip(row, asked, strict=True) for row in rows)
    )
    return "".join(f"| {' | '.join(line)} |\n" for line in (titles, marks, *cells))


def two_digits(value: object) -> str:
    """A number to two significant digits, without an exponent where it can do without; "-" for None."""
    return "-" if value is None else f"{float(f'{float(str(value)):.2g}'):g}"
