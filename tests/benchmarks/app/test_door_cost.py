"""What the door costs is measured beside viser without it, and a door that costs something is seen."""

import time

import pytest

from app.web.gateway import Gateway
from benchmarks.app import bench_app, door_cost, measuring_browser
from core.errors import CommandError


def test_the_same_is_measured_with_the_door_and_without() -> None:
    shares: list[float] = []
    rows = door_cost.measure_door(shares.append, turns=2)
    assert [row["exchange"] for row in rows] == list(door_cost.KINDS)
    assert [row["count"] for row in rows] == [2, 2, 2 * door_cost.UPDATES]
    assert all(row[f"{side}_{part}_ms"] > 0 for row in rows for side in ("plain", "door") for part in ("p50", "p99"))
    assert shares == sorted(shares) and shares[0] == 0


def test_a_door_that_thinks_for_long_is_seen_where_it_is_asked_and_not_afterwards(monkeypatch) -> None:
    answer = Gateway._answer

    def slow_answer(door: Gateway, request):
        time.sleep(0.2)
        return answer(door, request)

    monkeypatch.setattr(Gateway, "_answer", slow_answer)
    page, connection, update = door_cost.measure_door(turns=3)
    assert page["door_p50_ms"] - page["plain_p50_ms"] > 100
    assert connection["door_p50_ms"] - connection["plain_p50_ms"] > 100
    assert update["door_p50_ms"] - update["plain_p50_ms"] < 100


def test_another_part_is_refused() -> None:
    with pytest.raises(CommandError, match="window"):
        bench_app.run(lambda share: None, only="window")


def test_how_soon_a_page_is_back_cannot_be_measured_without_a_browser(monkeypatch) -> None:
    monkeypatch.setattr(measuring_browser, "find_chromium", lambda: None)
    with pytest.raises(CommandError, match="no Chromium"):
        bench_app.run(lambda share: None, only="return")
