from benchmarks.prediction.bench_prediction import LEADS_MS, measure_prediction


def test_a_small_measurement_has_both_methods_and_the_filter_is_nearer() -> None:
    report = measure_prediction(1)
    rows = {row["method"]: row for row in report["rows"]}  # pyright: ignore[reportGeneralTypeIssues, reportAttributeAccessIssue]
    assert set(rows) == {"filter", "paper"} and report["flights"] == 7
    name = "landing_80ms_ahead_median_mm"
    assert rows["filter"][name] < rows["paper"][name]
    assert len(report["leads"]) == 2 * len(LEADS_MS)  # pyright: ignore[reportArgumentType]
