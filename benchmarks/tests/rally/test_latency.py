"""What `bench rally --latency` makes of the stages of commands."""

import gc

from benchmarks.rally.latency import collector_pauses, ratio_of, spread, summary_of, to_sent_ms
from core.live.live_snapshot import STAGES

ROWS = [tuple(float(number) for _ in STAGES) for number in (1, 2, 3)]
NAN = float("nan")


def test_the_robots_answer_is_no_part_of_the_way_to_it() -> None:
    assert to_sent_ms(ROWS) == [8.0, 16.0, 24.0]
    summary = summary_of(ROWS)
    assert summary["commands"] == 3 and summary["window_to_command"]["worst"] == 24.0  # type: ignore[index]
    assert set(summary["stages"]) == set(STAGES)  # type: ignore[call-overload]
    assert summary["stages"]["robot"]["p50"] == 2.0  # type: ignore[index]


def test_a_ratio_is_of_both_percentiles_and_unknown_where_one_is() -> None:
    assert ratio_of(ROWS, [tuple(2 * value for value in row) for row in ROWS]) == {"p50": 0.5, "p99": 0.5}
    assert ratio_of(ROWS, []) == ratio_of([], ROWS) == {"p50": None, "p99": None}
    assert spread([NAN, 4.0]) == {"p50": 4.0, "p99": 4.0, "worst": 4.0}
    assert spread([NAN])["worst"] is None


def test_pauses_of_the_collector_are_noted_only_meanwhile() -> None:
    pauses: list[float] = []
    with collector_pauses(pauses):
        gc.collect()
    gc.collect()
    assert len(pauses) == 1 and pauses[0] >= 0
