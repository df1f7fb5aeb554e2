from benchmarks.calibration.bench_drift import alarm_row
from benchmarks.calibration.clicked_rigs import clicked_row


def test_rows_count_alarms_and_say_what_was_measured() -> None:
    moved, fits = (alarm_row("ceiling", drift_px, range(3)) for drift_px in (1.5, 0.0))
    assert moved["alarms"] == moved["of"] == 3 and fits["alarms"] == 0
    assert 1.0 < float(str(moved["measured_median_px"])) < 2.2 and float(str(fits["measured_p95_px"])) < 0.4


def test_clicked_corners_place_a_pair_to_some_millimetres_and_better_clicks_better() -> None:
    good, poor = (clicked_row("behind", px, range(6)) for px in (0.3, 1.5))
    assert int(str(good["corners"])) >= 6
    assert 0 < float(str(good["3d_mm_median"])) < float(str(poor["3d_mm_median"])) < 30
