"""The rally in figures, as HTML."""

from __future__ import annotations

import html
import math
from collections import Counter

import numpy as np

from app import theme
from app.scene.landing import CASE_NAMES, CASE_RGB
from core.physics.episode import Case
from core.rally.control.decision import RacketDecision
from core.rally.history.rally_history import Outcome, RallyMoment, RallyStep
from core.rally.link.messages import WorldState
from core.rally.live.live_snapshot import RallySnapshot
from core.trajectory.prediction import HitPlane


def moment_html(moment: RallyMoment, action_limit_deg: float, followed: float) -> str:
    """Ball, predictions and racket at one time; `followed` is the share of the recording that the chain has seen."""
    step = moment.step
    sent = moment.sent
    rows = [
        ("Ball", "-" if moment.speed_mps is None else f"{moment.speed_mps:.2f} m/s"),
        ("Contact in", _contact(step, moment.t_us)),
        ("Residual", _residual(step)),
        ("Before bounce", _hit(step.before.hit if step and step.before else None)),
        ("After bounce", _hit(step.after.hit if step and step.after else None)),
        ("Racket action", _action(sent, action_limit_deg)),
        ("Quaternion", "-" if sent is None else " ".join(f"{value:+.3f}" for value in sent.target.q_wxyz)),
        ("Aims at", _target(sent)),
        ("Last ball", _last(moment.outcomes)),
        ("Balls", _balls(moment.outcomes)),
    ]
    if followed < 1:
        rows.append(("Chain", f"<span style='color:{theme.MUTED}'>has seen {followed:.0%} of the recording</span>"))
    return _table(rows)


def live_html(snapshot: RallySnapshot, state: WorldState, status: str) -> str:
    """How well the live rally is followed."""
    health = snapshot.health
    slow = state.real_time_factor < 0.95 * state.speed_factor
    pace = f"{min(state.real_time_factor, state.speed_factor):.2f} x real time"
    colour = theme.BAD if slow or status != "connected" else theme.GOOD
    rows = [
        ("Simulation", f"<span style='color:{colour}'>{html.escape(status)}, {pace}</span>"),
        ("State", f"{health.state_hz:.0f} Hz, {_ms(health.step.p50_ms)} / {_ms(health.step.p99_ms)} ms a step"),
        ("Window to racket", f"{_ms(health.window_to_sent.p50_ms)} / {_ms(health.window_to_sent.p99_ms)} ms p50 / p99"),
        ("Controller", html.escape(snapshot.controller)),
    ]
    if state.readout_delayed or state.readout_dropped:
        rows.append(("Readout", _readout(state)))
    if health.blocks_dropped:
        rows.append(("Dropped", f"<span style='color:{theme.BAD}'>{health.blocks_dropped} blocks</span>"))
    if snapshot.problem:
        rows.append(("Problem", f"<span style='color:{theme.BAD}'>{html.escape(snapshot.problem)}</span>"))
    return _table(rows)


def _readout(state: WorldState) -> str:
    """What the cameras' readouts did to the events: late ones wait in a queue, lost ones are bad."""
    late = f"{state.readout_delayed:,} late, up to {state.readout_longest_us} us"
    if not state.readout_dropped:
        return late
    return f"{late}, <span style='color:{theme.BAD}'>{state.readout_dropped:,} events lost</span>"


def landing_legend_html() -> str:
    """Colours of the landing spots."""
    spots = " &nbsp; ".join(
        f"<span style='color:rgb{CASE_RGB[case]}'>&#9679;</span> {CASE_NAMES[case]}" for case in Case
    )
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:2px 12px'>{spots}</div>"


def _table(rows: list[tuple[str, str]]) -> str:
    cells = "".join(
        f"<tr><td style='color:{theme.MUTED};padding-right:10px;white-space:nowrap'>{name}</td><td>{value}</td></tr>"
        for name, value in rows
    )
    return f"<div style='font-size:12.5px;padding:2px 12px;line-height:1.45'><table>{cells}</table></div>"


def _contact(step: RallyStep | None, t_us: int) -> str:
    hit = _newest_hit(step)
    if hit is None or hit.t_s * 1e6 < t_us:
        return "-"
    return f"<b style='color:{theme.GOOD}'>{(hit.t_s * 1e6 - t_us) / 1e3:.0f} ms</b>"


def _newest_hit(step: RallyStep | None) -> HitPlane | None:
    if step is None:
        return None
    expected = step.after or step.before
    return None if expected is None else expected.hit


def _residual(step: RallyStep | None) -> str:
    if step is None or step.point is None:
        return "-"
    sigma_mm = 1e3 * float(np.sqrt(np.trace(step.point.covariance_m2) / 3))
    return f"{step.point.residual_px:.2f} px, sigma {sigma_mm:.1f} mm"


def _hit(hit: HitPlane | None) -> str:
    if hit is None:
        return "-"
    _, y, z = hit.p_world_m
    return f"y {y:+.3f}, z {z:+.3f} m, {float(np.linalg.norm(hit.v_world_mps)):.2f} m/s"


def _action(sent: RacketDecision | None, limit_deg: float) -> str:
    if sent is None:
        return "-"
    return ", ".join(f"{angle * limit_deg:+.1f}&deg;" for angle in sent.action) + f" ({sent.stage}-bounce)"


def _target(sent: RacketDecision | None) -> str:
    if sent is None or sent.landing_m is None:
        return "-"
    return f"x {sent.landing_m[0]:.2f}, y {sent.landing_m[1]:+.2f} m"


def _last(outcomes: tuple[Outcome, ...]) -> str:
    if not outcomes:
        return "-"
    last = outcomes[-1]
    where = f", {last.spot.x_m:.2f} / {last.spot.y_m:+.2f} m" if math.isfinite(last.spot.x_m) else ""
    return f"<span style='color:rgb{CASE_RGB[last.spot.case]}'>{CASE_NAMES[last.spot.case]}</span>{where}"


def _balls(outcomes: tuple[Outcome, ...]) -> str:
    if not outcomes:
        return "-"
    counts = Counter(outcome.spot.case for outcome in outcomes)
    returned = counts[Case.RETURNED]
    return f"{returned} of {len(outcomes)} returned ({returned / len(outcomes):.0%})"


def _ms(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
