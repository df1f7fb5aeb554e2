"""What Watch says of the calibration."""

from app import theme
from app.modes.watch.drift_words import drift_row
from core.cameras.epipolar import EpipolarDrift
from core.chain.calibration_drift import DriftReport

PAIR = ("left", "<b>right")


def report(drift_px: float, *, alarm: bool) -> DriftReport:
    return DriftReport(400, 200, PAIR, EpipolarDrift(drift_px, 0.1, 0.02), alarm)


def test_it_says_how_many_points_are_missing() -> None:
    name, said = drift_row(DriftReport(60, 200))
    assert name == "Calibration" and "not judged yet, after 60 of 200 points" in said


def test_a_fit_is_green_with_its_figure() -> None:
    said = drift_row(report(0.21, alarm=False))[1]
    assert "fits to 0.2 px (400 points" in said and theme.GOOD in said


def test_an_alarm_is_red_and_says_who_how_far_and_what_to_do() -> None:
    said = drift_row(report(1.23, alarm=True))[1]
    assert "The cameras left and &lt;b&gt;right no longer fit each other: 1.2 px off. One was moved" in said
    assert "calibrate again" in said and theme.BAD in said


def test_sightings_of_different_things_are_not_judged() -> None:
    said = drift_row(DriftReport(400, 200))[1]
    assert "cannot be judged" in said and "calibrate again" not in said
    assert "calibrate again" in drift_row(DriftReport(400, 200, alarm=True))[1]
