import pytest

from benchmarks.rally.bench_first_balls import run


def test_a_first_ball_is_played_without_and_with_the_reserve() -> None:
    found = run(lambda share: None, balls=1, speeds=(7.0,))
    without, kept, *over_all = found["rows"]  # type: ignore[misc]
    assert [row["reserve"] for row in (without, kept, *over_all)] == ["none", "kept", "none", "kept"]
    assert [row["speed_mps"] for row in over_all] == ["all", "all"]
    assert without["at_limit"] == 1 and kept["at_limit"] == 0, "this racket cannot follow the correction"
    gained_mm = without["landing_mm_worst"] - kept["landing_mm_worst"]
    assert found["nearer_mm"]["mean"] == pytest.approx(gained_mm)  # type: ignore[index]
