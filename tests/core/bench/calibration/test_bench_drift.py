from core.bench.calibration.bench_drift import alarm_row


def test_rows_count_alarms_and_say_what_was_measured() -> None:
    moved, fits = (alarm_row("ceiling", drift_px, range(3)) for drift_px in (1.5, 0.0))
    assert moved["alarms"] == moved["of"] == 3 and fits["alarms"] == 0
    assert 1.0 < float(str(moved["measured_median_px"])) < 2.2 and float(str(fits["measured_p95_px"])) < 0.4
