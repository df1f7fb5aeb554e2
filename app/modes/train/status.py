"""Status of a training as text and HTML."""

from __future__ import annotations

import math
from typing import Final

from app import theme
from app.formatting import html_text, percent, table_row
from app.modes.train.plan_view import NEW_BALLS, NEW_RGB
from app.modes.train.view import LISTED, Details
from app.scene.prediction import CASE_NAMES, CASE_RGB
from app.shared.trainer import RunPhase, RunState
from app.shared.training_records import Replay, number
from app.theme import hex_colour
from core.learning.config import CurriculumConfig, EnvironmentConfig, RunConfig
from core.physics.episode import Case
from core.text import counted

COLOURS: Final[dict[RunPhase, str]] = {
    "running": theme.GOOD,
    "starting": theme.GOOD,
    "finished": theme.GOOD,
    "failed": theme.BAD,
}
EVALUATIONS_SHOWN: Final = 12
NEWEST_COLOUR: Final = hex_colour(NEW_RGB)
CASE_HEX: Final = {case: hex_colour(rgb) for case, rgb in CASE_RGB.items()}
LONGEST_LOG_LINE: Final = 1000
LOG_STYLE: Final = "font-size:11.5px;white-space:pre-wrap;overflow-wrap:anywhere;margin:2px 0 0"
CELL: Final = "text-align:right;font-weight:400;padding:0 4px;white-space:nowrap"


def status_html(
    run: RunState | None, details: Details | None, active: RunState | None, bounds: tuple[str, ...] = ()
) -> str:
    """HTML of the chosen run, and of the running training if that is another. `bounds`: lines on limits by the racket's
    bounds.
    """
    if run is None:
        return _box("<b>Nothing trained yet.</b><br>Press <b>Train now</b> and watch a policy learn to place balls.")
    colour = COLOURS.get(run.phase, theme.MUTED)
    rows = [f"<b>{html_text(run.name)}</b> &nbsp; <span style='color:{colour}'>{run.phase}</span>"]
    if active is not None and active.name != run.name:
        rows.insert(0, f"<span style='color:{theme.GOOD}'>{html_text(active.name)} is being trained</span>")
    if run.phase == "failed":
        rows.append(f"<span style='color:{theme.BAD}'>{html_text(run.message)}</span>")
    rows.append(f"<span style='color:{theme.MUTED}'>{html_text(plan_text(run))}</span>")
    if details is not None and details.episodes_done:
        rows.append(_progress_text(run, details))
        rows.append(f"last balls, with exploration noise: {_result(details.returned, details.error_mm)}")
        if details.evaluations:
            line = details.evaluations[-1]
            rows.append(_policy_text(run, line))
    rows += [f"<span style='color:{theme.MUTED}'>{html_text(words)}</span>" for words in bounds]
    return _box("<br>".join(rows))


def _policy_text(run: RunState, line: dict[str, object]) -> str:
    """What the policy of an evaluation is worth; of a finished run, the sentence that sums it up."""
    learned = learned_text(run.config, line) if run.phase == "finished" else ""
    if learned:
        return f"<b>Learned: it {learned}.</b>"
    returned, error_mm = 100 * number(line.get("returned")), number(line.get("error_mm"))
    return f"policy after {line.get('episode')}: {_result(returned, error_mm)}"


def learned_text(config: RunConfig, line: dict[str, object]) -> str:
    """What the policy of an evaluation does, as the end of a sentence; empty where no ball landed."""
    returned, error_mm = 100 * number(line.get("returned")), number(line.get("error_mm"))
    if not math.isfinite(error_mm):
        return ""
    speed = "" if config.environment.recorded else f" at {number(line.get('speed_mps')):g} m/s"
    what = f"returns {returned:.0f} % of the balls{speed}, {error_mm:.0f} mm from the target"
    return f"{what}, after {counted(int(number(line.get('episode'))), 'ball')}"


def plan_text(run: RunState) -> str:
    """One line about what is trained."""
    config = run.config
    curriculum = config.curriculum
    stages = ", ".join(
        f"{count} at {speed:g} m/s" for speed, count in zip(curriculum.speeds_mps, curriculum.episodes, strict=True)
    )
    if config.environment.recorded:
        stages = counted(config.episodes, "recorded ball")
    seeds = "" if config.seeds == 1 else f", {config.seeds} seeds"
    return f"{config.agent}, {config.reward.kind} reward, {stages}{seeds}{_differing_text(config.environment)}"


def _differing_text(environment: EnvironmentConfig) -> str:
    """What differs from ball to ball, as the end of a line; empty where nothing does."""
    names = [*environment.randomise.names, *(["racket"] if environment.racket == "uncertain" else [])]
    return f"; another with every ball: {', '.join(names)}" if names else ""


def _progress_text(run: RunState, details: Details) -> str:
    text = f"ball {details.episodes_done} of {run.config.episodes}"
    if run.config.seeds > 1:
        text += f", seed {details.seed}"
    if run.status is not None and run.active:
        stages = len(run.config.curriculum.speeds_mps)
        if stages > 1:
            text += f", stage {len(details.stage_starts) + 1} of {stages}"
        text += f", {run.status.speed_mps:g} m/s"
        if run.status.seconds_left is not None and run.phase == "running":
            text += f", {time_text(run.status.seconds_left)} left"
    return text


def time_text(seconds: float) -> str:
    """Readable text of a duration."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def why_no_ball(run: RunState | None, details: Details | None) -> str:
    """Why the scene has no ball; empty while it is not known what the run has played."""
    if run is None:
        return "the table, without a ball"
    if run.active or (details is not None and details.recent):
        return "no ball yet"
    return "" if details is None else "this run has played no ball"


def no_ball_html(why: str) -> str:
    """HTML of a scene without a ball, as high with a reason as without one."""
    return _box(f"<span style='color:{theme.MUTED}'>{why or '&nbsp;'}</span>")


def ball_html(replay: Replay) -> str:
    """HTML of the ball in the scene."""
    colour = CASE_HEX[replay.case]
    end = CASE_NAMES[replay.case]
    if math.isfinite(replay.error_mm):
        end += f", {replay.error_mm:.0f} mm from the target"
    title = f"ball {replay.ball.episode + 1} at {replay.ball.speed_mps:g} m/s, {replay.title}"
    return _box(f"{html_text(title)}<br><span style='color:{colour}'>●</span> {end}")


def case_counts_html(counts: dict[Case, int]) -> str:
    """HTML of the number of balls per case, in the landing points' colours."""
    total = max(1, sum(counts.values()))
    cells = [
        f"<span style='white-space:nowrap'><span style='color:{CASE_HEX[case]}'>●</span> "
        f"{CASE_NAMES[case]} {counts[case]} "
        f"<span style='color:{theme.MUTED}'>{percent(counts[case] / total)}</span></span>"
        for case in Case
    ]
    return _box(" &nbsp; ".join(cells))


def offsets_title_html() -> str:
    """HTML title of the picture of offsets."""
    return _box(
        f"Landings around their target; <span style='color:{NEWEST_COLOUR}'>●</span> the last {NEW_BALLS} balls"
    )


def map_html(words: tuple[str, ...]) -> str:
    """HTML of a policy map's text lines."""
    return _box("<br>".join(html_text(line, LONGEST_LOG_LINE) for line in words))


def log_html(log: tuple[str, ...], details: Details | None) -> str:
    """HTML of the last evaluations and the end of the log."""
    titles = table_row(("after ball", "serves", "returned", "error"), CELL, tag="th")
    lines = details.evaluations if details is not None else ()
    rows = "".join(_evaluation_row(line) for line in lines[-EVALUATIONS_SHOWN:])
    text = "\n".join(html_text(line, LONGEST_LOG_LINE) for line in log) or "nothing yet"
    return _box(
        f"<b>The policy on the fixed balls</b><table style='width:100%'>{titles}{rows}</table>"
        f"<b>Log</b><pre style='{LOG_STYLE}'>{text}</pre>"
    )


def runs_html(runs: tuple[RunState, ...], results: dict[str, dict[str, object]]) -> str:
    """HTML list of runs with their last evaluations."""
    titles = "".join(
        f"<th style='{CELL};text-align:{side}'>{title}</th>"
        for side, title in (
            ("left", "run"),
            ("left", "agent"),
            ("right", "at"),
            ("right", "returned"),
            ("right", "error"),
        )
    )
    rows = "".join(_run_row(run, results.get(run.name, {})) for run in runs[:LISTED])
    more = f"and {len(runs) - LISTED} older" if len(runs) > LISTED else ""
    return _box(f"<table style='width:100%;font-size:11.5px'><tr>{titles}</tr>{rows}</table>{more}")


def _run_row(run: RunState, line: dict[str, object]) -> str:
    speed, error = number(line.get("speed_mps")), number(line.get("error_mm"))
    returned = 100 * number(line.get("returned"))
    colour = COLOURS.get(run.phase, theme.MUTED)
    cells = (
        ("left", f"<span style='color:{colour}' title='{run.phase}'>●</span> {html_text(run.name)}"),
        ("left", run.config.agent),
        ("right", f"{speed:g} m/s" if math.isfinite(speed) else "-"),
        ("right", f"{returned:.0f} %" if math.isfinite(returned) else "-"),
        ("right", f"{error:.0f} mm" if math.isfinite(error) else "-"),
    )
    shown = "".join(f"<td style='{CELL};text-align:{side}'>{cell}</td>" for side, cell in cells)
    return f"<tr>{shown}</tr>"


def _evaluation_row(line: dict[str, object]) -> str:
    error = number(line.get("error_mm"))
    cells = (
        f"{number(line.get('episode')):.0f}",
        f"{number(line.get('speed_mps')):g} m/s",
        f"{100 * number(line.get('returned')):.1f} %",
        f"{error:.0f} mm" if math.isfinite(error) else "-",
    )
    return table_row(cells, CELL)


def _result(returned: float, error_mm: float) -> str:
    error = f", {error_mm:.0f} mm from the target" if math.isfinite(error_mm) else ""
    return f"{returned:.0f} % returned{error}"


def _box(content: str) -> str:
    return f"<div style='font-size:12.5px;line-height:1.5;padding:4px 12px'>{content}</div>"


MAX_STAGES: Final = 20
BAR: Final = "display:inline-block;height:9px;vertical-align:middle"
FADED: Final = 0.28


def kept_html(stage_starts: tuple[dict[str, object], ...], curriculum: CurriculumConfig) -> str:
    """HTML with a bar for each stage but the first: kept transitions in full colour, dropped ones faded."""
    rows = [row for line in stage_starts[-MAX_STAGES:] if (row := _stage(line))]
    if not rows:
        return ""
    return (
        f"<div style='font-size:12.5px;line-height:1.5;padding:4px 12px'><b>Balls kept from earlier stages</b> "
        f"<span style='color:{theme.MUTED}'>({rule_text(curriculum)}; dropped ones faded)</span>{''.join(rows)}</div>"
    )


def rule_text(curriculum: CurriculumConfig) -> str:
    """Text of the replay rule."""
    if curriculum.replay == "threshold":
        return f"threshold: rewards of at least {curriculum.keep_reward:g}"
    return "retain: all" if curriculum.replay == "retain" else "discard: none"


def _stage(line: dict[str, object]) -> str:
    kept, dropped = _integer(line.get("kept")), _integer(line.get("dropped"))
    stage, speed = line.get("stage"), line.get("speed_mps")
    if not isinstance(stage, int) or not isinstance(speed, (int, float)) or kept + dropped == 0:
        return ""
    title = f"stage {stage + 1}, {speed:g} m/s: {kept} of {kept + dropped} kept"
    return f"<div>{title}</div>{_bar(_cases(line.get('kept_cases')))}"


def _cases(found: object) -> list[tuple[Case, int, int]]:
    """Case, kept, dropped; empty for runs of earlier versions, which did not record it."""
    if not isinstance(found, dict):
        return []
    counts = [(case, found.get(str(case.value))) for case in (Case.RETURNED, *(c for c in Case if c != Case.RETURNED))]
    return [
        (case, _integer(two[0]), _integer(two[1])) for case, two in counts if isinstance(two, list) and len(two) == 2
    ]


def _bar(cases: list[tuple[Case, int, int]]) -> str:
    total = sum(kept + dropped for _, kept, dropped in cases)
    if not total:
        return ""
    parts = [(case, kept, 1.0) for case, kept, _ in cases] + [(case, dropped, FADED) for case, _, dropped in cases]
    bar = "".join(
        f"<span style='{BAR};width:{99 * count / total:.2f}%;background:{CASE_HEX[case]};opacity:{opacity:g}'></span>"
        for case, count, opacity in parts
        if count
    )
    words = " &nbsp; ".join(
        f"<span style='white-space:nowrap'><span style='color:{CASE_HEX[case]}'>●</span> {CASE_NAMES[case]} "
        f"{kept} of {kept + dropped}</span>"
        for case, kept, dropped in cases
    )
    return f"<div style='line-height:1;white-space:nowrap'>{bar}</div><div style='font-size:11.5px'>{words}</div>"


def _integer(value: object) -> int:
    return value if isinstance(value, int) and 0 <= value < 10**9 else 0
