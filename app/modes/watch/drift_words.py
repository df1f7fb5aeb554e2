"""Whether the cameras still fit each other, in plain words, as a row of HTML."""

from __future__ import annotations

from app import theme
from app.formatting.file_text import html_text
from app.modes.watch.figures import coloured, muted
from core.chain.calibration_drift import DriftReport

REMEDY = "One was moved, or its lens: calibrate again"


def drift_row(report: DriftReport) -> tuple[str, str]:
    """What the last flights say of the calibration."""
    drift = report.drift
    if drift is None:
        if report.points >= report.needed:
            said = "cannot be judged: the cameras see different things"
            return "Calibration", coloured(theme.WARN, f"{said}. {REMEDY}" if report.alarm else said)
        said = f"not judged yet, after {report.points} of {report.needed} points of the ball"
        return "Calibration", muted(said)
    if report.alarm:
        return "Calibration", coloured(theme.BAD, f"{drift_words(report)}. {REMEDY}")
    said = f"fits to {drift.drift_px:.1f} px ({report.points} points of the ball)"
    return "Calibration", coloured(theme.GOOD, said)


def drift_words(report: DriftReport) -> str:
    """That they no longer fit, in one sentence without its stop."""
    drift = report.drift
    how_far = "" if drift is None else f": {drift.drift_px:.1f} px off"
    names = "" if report.pair is None else f" {html_text(report.pair[0])} and {html_text(report.pair[1])}"
    return f"The cameras{names} no longer fit each other{how_far}"
