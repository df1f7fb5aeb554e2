from app.cli.terminal import format_table


def test_rows_become_a_table_with_numbers_under_their_titles() -> None:
    rows: list[dict[str, object]] = [{"mode": "full", "p50_ms": 0.1234, "windows": 1000}]
    rows.append({"mode": "roi", "p50_ms": None, "windows": 7})
    assert format_table(rows).splitlines() == [
        "mode  p50_ms  windows",
        "full   0.123     1000",
        " roi       -        7",
    ]
    assert format_table([]) == "nothing was measured"
