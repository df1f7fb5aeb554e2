"""Figures of the rally as HTML."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Final

import numpy as np

from app import theme
from app.formatting import html_text, percent
from app.modes.watch.figures import coloured, figures_html, latency_rows, learned_words, muted, percentiles_text
from app.modes.watch.stream_status import camera_rows
from app.scene.prediction import CASE_NAMES, CASE_RGB
from core.chain.calibration_drift import DriftReport
from core.chain.control.controller import RacketDecision
from core.history.rally_history import EXPECTED_US, Outcome, RallyMoment, RallyStep
from core.history.shown_prediction import ShownPrediction
from core.live.link.adaptive_rate import pace_words
from core.live.link.messages import WorldState
from core.live.live_player import NOBODY
from core.live.live_snapshot import PlayerHealth, RallySnapshot
from core.live.stream_watch import CameraHealth
from core.physics.episode import Case
from core.text import counted

REMEDY = "A camera or lens was moved: calibrate again"


def drift_row(report: DriftReport) -> tuple[str, str]:
    """Row with the calibration's drift as seen by the last flights."""
    drift = report.drift
    if drift is None:
        if report.points >= report.needed > 0:
            message = "unknown: the cameras see different objects"
            return "Calibration", coloured(theme.WARN, f"{message}. {REMEDY}" if report.alarm else message)
        # 0: before a chain was made nobody has said how many.
        known = f" ({report.points} of {report.needed} points)" if report.needed else ""
        return "Calibration", muted(f"Not yet known{known}")
    if report.alarm:
        return "Calibration", coloured(theme.BAD, f"{drift_words(report)}. {REMEDY}")
    message = f"fits to {drift.drift_px:.2f} px ({counted(report.points, 'point')} of the ball)"
    return "Calibration", coloured(theme.GOOD, message)


def drift_words(report: DriftReport) -> str:
    """Text of a calibration that no longer fits, without a full stop."""
    drift = report.drift
    how_far = "" if drift is None else f": {drift.drift_px:.1f} px off"
    moved = () if report.pair is None else report.pair if report.camera is None else (report.camera,)
    names = f" of {' and '.join(map(html_text, moved))}" if moved else ""
    return f"The calibration{names} has drifted{how_far}"


CHANGING: Final = {
    "Ball speed": "no ball followed",
    "Hit at": "no hit expected",
    "Stereo mismatch": "no ball in 3D",
    "Placed by": "no ball in 3D",
    "Hit predicted before the bounce": "none now",
    "Hit predicted after the bounce": "none now",
    "Hit chosen": "none now",
}
"""Rows that stay without a value, with why there is none: they come and go with each flight, and others would move."""
NOT_REACHED: Final = "not followed up to here yet"
"""Why they have no value while the chain has not reached the cursor."""
STAGES: Final = {"pre": "before the bounce", "post": "after the bounce"}


def moment_html(
    moment: RallyMoment,
    action_limit_deg: float,
    followed: float,
    *,
    robot: bool = True,
    outcomes: bool = True,
    returned: bool = True,
    drift: DriftReport | None = None,
    cameras: Collection[str] = (),
    reached: bool = True,
) -> str:
    """Ball, predictions and racket at one time; `followed` is the share of the recording that the chain has seen.

    `reached`: whether it has seen this time. If not, its last step is of another one, and no place of a ball is shown.

    Without a robot nothing is said of a racket, and without word of outcomes only what was seen of strokes; how many
    came back only where no panel counts them by controller and scene. `drift` is of all that was followed so far. Of
    three `cameras` or more it is said which the ball's place is made of.
    """
    step = moment.step
    newest = step if reached else None
    sent = moment.sent
    rows = [
        ("Ball speed", "-" if moment.speed_mps is None else f"{moment.speed_mps:.2f} m/s"),
        ("Hit at", _hit_at(moment)),
        ("Stereo mismatch", _residual(newest)),
        *([("Placed by", _used(newest, cameras))] if len(cameras) > 2 else []),
        *([] if drift is None else [drift_row(drift)]),
        ("Hit predicted before the bounce", _hit(step.before if step else None, moment.t_us)),
        ("Hit predicted after the bounce", _hit(step.after if step else None, moment.t_us)),
    ]
    if robot:
        rows += [
            ("Hit chosen", _chosen(step, moment.t_us)),
            ("Racket turned by", _action(sent, action_limit_deg)),
            ("Racket pose, wxyz", "-" if sent is None else " ".join(f"{value:+.3f}" for value in sent.target.q_wxyz)),
            ("Aims at", _target(sent)),
        ]
    if outcomes:
        rows.append(("Last ball", _last(moment.outcomes)))
        if returned:
            rows.append(("Returned", _balls(moment.outcomes)))
    elif moment.outcomes:
        rows += [("Last stroke, as seen", _last(moment.outcomes)), ("Strokes, as seen", _balls(moment.outcomes))]
    if followed < 1:
        rows.append(("Followed", muted(f"{percent(followed)} of the recording so far")))
    shown = [
        (name, muted(CHANGING[name] if reached else NOT_REACHED) if value == "-" else value)
        for name, value in rows
        if value != "-" or name in CHANGING
    ]
    return figures_html(shown)


def live_html(snapshot: RallySnapshot, state: WorldState, status: str, cameras: tuple[CameraHealth, ...] = ()) -> str:
    """HTML of how well a simulated rally is processed, and of camera problems."""
    health = snapshot.health
    rows = [
        ("Simulation", _simulation(state, status)),
        *(
            [("Followed", muted("not yet: the player is loading"))]
            if snapshot.problem == NOBODY
            else [
                ("Followed", _followed(health)),
                ("Seen to racket", _seen_to_racket(health, state)),
                *latency_rows(health),
            ]
        ),
        ("Controller", html_text(snapshot.controller)),
    ]
    if snapshot.learned is not None:
        rows.append(("Air and table", learned_words(snapshot.learned)))
    rows += camera_rows(cameras)
    if state.readout_delayed or state.readout_dropped:
        rows.append(("Sensor readout", _readout(state)))
    if health.blocks_dropped:
        skipped = f"{counted(health.blocks_dropped, 'block')} of 10 ms since the session began: this machine was busy"
        rows.append(("Skipped blocks", muted(f"{skipped}. A recording has them. Many? Choose a slower Pace")))
    if snapshot.problem and snapshot.problem != NOBODY:
        rows.append(("Problem", coloured(theme.BAD, html_text(snapshot.problem))))
    return figures_html(rows)


def _followed(health: PlayerHealth) -> str:
    if math.isnan(health.step.p50_ms):
        return muted("no window yet")
    return f"{health.state_hz:.0f} times a second, {percentiles_text(health.step)} each"


def _seen_to_racket(health: PlayerHealth, state: WorldState) -> str:
    if math.isnan(health.window_to_sent.p50_ms):
        return muted("no command yet")
    return f"{percentiles_text(health.window_to_sent)}{_on_the_clock(state)}"


def _simulation(state: WorldState, status: str) -> str:
    """Row of the simulation's connection and speed, with what to do about problems."""
    if status != "connected":
        return coloured(theme.BAD, f"{html_text(status)}, no connection: restart Rallyscope")
    if state.paused:
        return f"{html_text(status)}, it is paused: press Run"
    speed = state.speed_factor * state.kept_share
    if state.kept_share < 1.0:
        asked = "" if state.speed_factor == 1.0 else f" instead of {pace_words(state.speed_factor)}"
        kept = f"{pace_words(speed)}{asked}: this machine is busy"
        return coloured(theme.WARN, f"{html_text(status)}, {kept}")
    pace = f"{min(state.real_time_factor, speed):.2f} x real time"
    if state.real_time_factor < 0.95 * speed:
        return coloured(theme.BAD, f"{html_text(status)}, only {pace}: choose a slower Pace")
    return coloured(theme.GOOD, f"{html_text(status)}, {pace}")


def _on_the_clock(state: WorldState) -> str:
    """What makes a latency long that is none of a robot: a block of a slow simulation takes longer to be whole."""
    pace = min(state.real_time_factor, state.speed_factor * state.kept_share)
    return "" if pace > 0.9 or state.paused else muted(f" on the clock, with {pace:.2f} s simulated a second")


def _readout(state: WorldState) -> str:
    """Row of late and lost events of the cameras' readouts."""
    late = f"{state.readout_delayed:,} late, up to {state.readout_longest_us} us"
    if not state.readout_dropped:
        return late
    lost = f"{counted(state.readout_dropped, 'event')} lost: reduce Noise"
    return f"{late}, {coloured(theme.BAD, lost)}"


def landing_legend_html() -> str:
    """HTML legend of the landing points."""
    spots = " &nbsp; ".join(
        f"<span style='color:rgb{CASE_RGB[case]}'>&#9679;</span> {CASE_NAMES[case]}" for case in Case
    )
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:2px 12px'>{spots}</div>"


def _hit_at(moment: RallyMoment) -> str:
    """Predicted time of the hit that the 3D view counts down to.

    Not a second countdown: these figures change a few times a second, and would be behind the 3D view.
    """
    hit_in_s = moment.picture.hit_in_s
    if hit_in_s is None:
        return "-"
    return f"<b style='color:{theme.GOOD}'>{1e-6 * moment.t_us + hit_in_s:.3f} s</b>"


def _residual(step: RallyStep | None) -> str:
    if step is None or step.point is None:
        return "-"
    sigma_mm = 1e3 * float(np.sqrt(np.trace(step.point.covariance_m2) / 3))
    return f"{step.point.residual_px:.2f} px, ball &plusmn;{sigma_mm:.1f} mm"


def _used(step: RallyStep | None, cameras: Collection[str]) -> str:
    """How many cameras tell where the ball is, and what each of the others found."""
    if step is None or step.point is None:
        return "-"
    others = [name for name in cameras if name not in step.used]
    words = [f"{html_text(name)}: {'something else' if name in step.circles else 'no ball'}" for name in others]
    count = f"{len(cameras) - len(others)} of {len(cameras)} cameras"
    return "; ".join([count, *map(muted, words)])


def _hit(expected: ShownPrediction | None, t_us: int) -> str:
    hit = None if expected is None else expected.hit
    if expected is None or hit is None or t_us > expected.end_us + EXPECTED_US:
        return "-"
    _, y, z = hit.p_world_m
    return f"y {y:+.3f}, z {z:+.3f} m, {float(np.linalg.norm(hit.v_world_mps)):.2f} m/s"


def _chosen(step: RallyStep | None, t_us: int) -> str:
    """The place where the ball is to be hit, of how many that were possible, or why there is none."""
    expected = None if step is None else step.after or step.before
    if expected is None or t_us > expected.end_us + EXPECTED_US:
        return "-"
    if expected.no_stroke:
        return coloured(theme.WARN, html_text(expected.no_stroke))
    choice, hit = expected.choice, expected.hit
    if choice is None or choice.chosen is None or hit is None:
        return "-"
    possible = sum(not one.why_not for one in choice.candidates)
    chance = muted(f"chance {percent(choice.chosen.chance)}, {possible} of {len(choice.candidates)} places possible")
    return f"x {hit.p_world_m[0]:.2f}, z {hit.p_world_m[2]:+.2f} m, {chance}"


def _action(sent: RacketDecision | None, limit_deg: float) -> str:
    if sent is None:
        return "-"
    return ", ".join(f"{angle * limit_deg:+.1f}&deg;" for angle in sent.action) + f" {STAGES[sent.stage]}"


def _target(sent: RacketDecision | None) -> str:
    if sent is None or sent.landing_m is None:
        return "-"
    return f"x {sent.landing_m[0]:.2f}, y {sent.landing_m[1]:+.2f} m"


def _last(outcomes: tuple[Outcome, ...]) -> str:
    if not outcomes:
        return "-"
    last = outcomes[-1]
    if not last.counted:
        return muted("not followed, or something changed during it: not counted")
    y_m = round(last.spot.y_m, 2) + 0.0  # no -0.00
    where = f", {last.spot.x_m:.2f} / {y_m:+.2f} m" if math.isfinite(last.spot.x_m) else ""
    return f"<span style='color:rgb{CASE_RGB[last.spot.case]}'>{CASE_NAMES[last.spot.case]}</span>{where}"


def _balls(outcomes: tuple[Outcome, ...]) -> str:
    cases = [outcome.spot.case for outcome in outcomes if outcome.counted]
    if not cases:
        return "-"
    returned = cases.count(Case.RETURNED)
    return f"{returned} of {len(cases)} returned ({percent(returned / len(cases))})"
