"""What each stage of a training kept of the balls before it, by their cases."""

from __future__ import annotations

from typing import Final

from app import theme
from app.scene.landing import CASE_NAMES, CASE_RGB
from core.learning.config import CurriculumConfig
from core.physics.episode import Case

MAX_STAGES: Final = 20
BAR: Final = "display:inline-block;height:9px;vertical-align:middle"
FADED: Final = 0.28


def kept_html(stage_starts: tuple[dict[str, object], ...], curriculum: CurriculumConfig) -> str:
    """A bar for each stage but the first: what was kept in full colour, what was dropped faded; empty without one."""
    rows = [row for line in stage_starts[-MAX_STAGES:] if (row := _stage(line))]
    if not rows:
        return ""
    return (
        f"<div style='font-size:12.5px;line-height:1.5;padding:4px 12px'><b>What a stage kept of the balls before</b> "
        f"<span style='color:{theme.MUTED}'>({rule_text(curriculum)}; dropped ones faded)</span>{''.join(rows)}</div>"
    )


def rule_text(curriculum: CurriculumConfig) -> str:
    """The rule in words."""
    if curriculum.replay == "threshold":
        return f"threshold: rewards of at least {curriculum.keep_reward:g}"
    return "retain: all" if curriculum.replay == "retain" else "discard: none"


def _stage(line: dict[str, object]) -> str:
    kept, dropped = _count(line.get("kept")), _count(line.get("dropped"))
    stage, speed = line.get("stage"), line.get("speed_mps")
    if not isinstance(stage, int) or not isinstance(speed, (int, float)) or kept + dropped == 0:
        return ""
    title = f"stage {stage + 1}, {speed:g} m/s: {kept} of {kept + dropped} kept"
    return f"<div>{title}</div>{_bar(_cases(line.get('kept_cases')))}"


def _cases(found: object) -> list[tuple[Case, int, int]]:
    """Case, kept, dropped; none for a run of an earlier version, which did not tell."""
    if not isinstance(found, dict):
        return []
    counts = [(case, found.get(str(case.value))) for case in (Case.RETURNED, *(c for c in Case if c != Case.RETURNED))]
    return [(case, _count(two[0]), _count(two[1])) for case, two in counts if isinstance(two, list) and len(two) == 2]


def _bar(cases: list[tuple[Case, int, int]]) -> str:
    total = sum(kept + dropped for _, kept, dropped in cases)
    if not total:
        return ""
    parts = [(case, kept, 1.0) for case, kept, _ in cases] + [(case, dropped, FADED) for case, _, dropped in cases]
    bar = "".join(
        f"<span style='{BAR};width:{99 * count / total:.2f}%;background:{_hex(case)};opacity:{opacity:g}'></span>"
        for case, count, opacity in parts
        if count
    )
    words = " &nbsp; ".join(
        f"<span style='white-space:nowrap'><span style='color:{_hex(case)}'>●</span> {CASE_NAMES[case]} "
        f"{kept} of {kept + dropped}</span>"
        for case, kept, dropped in cases
    )
    return f"<div style='line-height:1;white-space:nowrap'>{bar}</div><div style='font-size:11.5px'>{words}</div>"


def _count(value: object) -> int:
    return value if isinstance(value, int) and 0 <= value < 10**9 else 0


def _hex(case: Case) -> str:
    return "#{:02x}{:02x}{:02x}".format(*CASE_RGB[case])
