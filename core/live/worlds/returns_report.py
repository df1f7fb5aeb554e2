"""Report of the balls of human play that the simulated robot returns, by speed and by spin."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.live.worlds.simulated_returns import ReturnOutcome, SimulatedReturns, SimulatedReturnsConfig
from core.metrics.charts import heat_map
from core.metrics.intervals import binomial_interval
from core.physics.ball_states import join_serves
from core.physics.episode import Serves
from core.simulation.episodes.incoming import Incoming
from core.text.markdown_table import markdown_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = dict[str, object]

SPEED_EDGES_MPS: Final = (0.0, 4.0, 5.0, 6.0, 7.0, 8.0, np.inf)
SPIN_EDGES_RADPS: Final = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, np.inf)
INCOMING_WORDS: Final = {
    Incoming.NET: "into the net before the robot",
    Incoming.NO_BOUNCE: "no bounce on the robot's half",
    Incoming.FAR_HALF: "down on the opponent's half",
    Incoming.TWO_BOUNCES: "two bounces before the hitting plane",
    Incoming.SHORT: "off the table's side, not as far as the hitting plane",
}
FATE_WORDS: Final = {
    ReturnOutcome.NO_STROKE: "no stroke within the bounds",
    ReturnOutcome.OUT_OF_REACH: "out of the racket's reach",
    ReturnOutcome.NO_TIME: "racket not there, or not as it should be, in time",
    ReturnOutcome.OWN_HALF: "struck onto the own half",
    ReturnOutcome.NET: "struck into the net",
    ReturnOutcome.LONG: "struck beyond the table",
    ReturnOutcome.WIDE: "struck beside the table",
}


@dataclass(frozen=True, slots=True, eq=False)
class PlayedFile:
    """The balls of one file and their outcomes."""

    name: str
    balls: Serves
    played: SimulatedReturns


def summary_row(name: str, played: SimulatedReturns, which: Mask) -> Row:
    """Counts, and the share of the playable balls that came back, with its 95 % interval."""
    playable = int((which & (played.fate != ReturnOutcome.NOT_PLAYABLE)).sum())
    errors = 1e3 * played.error_m[which & (played.fate == ReturnOutcome.RETURNED)]
    returned = len(errors)
    low, high = binomial_interval(returned / playable, playable) if playable else (None, None)
    median, p95 = np.percentile(errors, (50, 95)).tolist() if returned else (None, None)
    return {
        "balls": name,
        "count": int(which.sum()),
        "playable": playable,
        "returned": returned,
        "share": returned / playable if playable else None,
        "low": low,
        "high": high,
        "error_mm_median": median,
        "error_mm_p95": p95,
    }


def losses(played: SimulatedReturns) -> dict[str, int]:
    """Number of lost balls by cause."""
    found = {words: int((played.incoming == kind).sum()) for kind, words in INCOMING_WORDS.items()}
    found |= {words: played.count(fate) for fate, words in FATE_WORDS.items()}
    return {words: count for words, count in found.items() if count}


def report_rows(files: Sequence[PlayedFile]) -> dict[str, list[Row]]:
    """Rows by file, by speed at the state and by spin there."""
    whole = _joined(files)
    return {
        "files": [_row_of(file) for file in files],
        "speeds": [summary_row(f"{name} m/s", whole.played, which) for name, which in _by_speed(whole.balls)],
        "spins": [summary_row(f"{name} rad/s", whole.played, which) for name, which in _by_spin(whole.balls)],
    }


def write_ball_states_report(
    path: Path, files: Sequence[PlayedFile], config: SimulatedReturnsConfig, command: str
) -> None:
    """The page, and its picture in `images/` beside it."""
    whole, rows = _joined(files), report_rows(files)
    every = _row_of(whole)
    lost = {file.name: losses(file.played) for file in files}
    words = [
        one for one in (*INCOMING_WORDS.values(), *FATE_WORDS.values()) if any(one in each for each in lost.values())
    ]
    parts = [
        "# Balls of human play against the simulated robot\n",
        f"Made by `{command}`.\n",
        *(f"{textwrap.fill(text, 118)}\n" for text in (_about_balls(every, config), _about_robot(config))),
        _table([*rows["files"], every] if len(files) > 1 else rows["files"]),
        "## By speed where the state begins\n",
        _table(rows["speeds"]),
        "## By spin there\n",
        _table(rows["spins"]),
        f"![returned by speed and spin](images/{path.stem}.svg)\n",
        "## What the others were lost to\n",
        markdown_table(("", *lost), [[one, *(each.get(one, 0) for each in lost.values())] for one in words],
                       ("", *[","] * len(lost))),
    ]  # fmt: skip
    path.write_text("\n".join(parts), encoding="utf-8")
    _draw(path.parent / "images" / f"{path.stem}.svg", whole)


def _about_balls(row: Row, config: SimulatedReturnsConfig) -> str:
    when = f"{config.told_after_ms:g} ms after the launch" if config.told_after_ms else "at the launch"
    return (
        "The files hold states of balls in human play: position, velocity and spin. Each is launched as it is. "
        f"Of {row['count']:,} balls {row['playable']:,} are playable: they bounce once on the robot's half (a service "
        f"on the other half first) and come to the hitting plane, x = {config.task.stroke.hit_plane_x_m:g} m. "
        f"**{row['returned']:,} come back.** The built-in controller plays with perfect knowledge: {when} it is told "
        "exactly when, where, how fast and with which spin the ball will cross the plane. So this is what arm and "
        "strokes can do, without any error of perception."
    )


def _about_robot(config: SimulatedReturnsConfig) -> str:
    air, top = config.task.physics.air, config.task.physics.table
    racket, bounds = config.racket, config.controller
    return (
        f"Physics: drag {air.drag_coefficient:g}, Magnus {air.magnus_coefficient:g}, table {top.restitution:g} and "
        f"{top.friction:g}. Racket: {racket.max_speed_mps:g} m/s, {racket.max_acceleration_mps2:g} m/s², within "
        f"{racket.reach_m:g} m of its place; strokes along x with {bounds.slowest_mps:g} to {bounds.fastest_mps:g} "
        f"m/s, angles within {config.task.stroke.action_limit_deg:g} degrees, target ({bounds.target_x_m:g}, "
        f"{bounds.target_y_m:g}) m. The distance from the target is that of returned balls; where no safe stroke "
        "reaches it, one that lands elsewhere is played."
    )


def _table(rows: Sequence[Row]) -> str:
    def text(row: Row, key: str, form: str, scale: int = 1) -> str:
        value = row[key]
        return format(scale * value, form) if isinstance(value, float) else "-"

    cells = [
        [
            *(row[key] for key in ("balls", "count", "playable", "returned")),
            f"{text(row, 'share', '.1f', 100)} [{text(row, 'low', '.1f', 100)}, {text(row, 'high', '.1f', 100)}]",
            f"{text(row, 'error_mm_median', '.1f')} / {text(row, 'error_mm_p95', '.0f')}",
        ]
        for row in rows
    ]
    titles = (
        "balls",
        "count",
        "playable",
        "returned",
        "of the playable, % [95 %]",
        "off the target, mm, median / 95 %",
    )
    return markdown_table(titles, cells, ("", ",", ",", ","))


def _draw(path: Path, whole: PlayedFile) -> None:
    by_speed, by_spin = _by_speed(whole.balls), _by_spin(whole.balls)
    playable, returned = whole.played.fate != ReturnOutcome.NOT_PLAYABLE, whole.played.fate == ReturnOutcome.RETURNED
    counts, hits = (
        np.array([[(counted & a & b).sum() for _, a in by_speed] for _, b in by_spin])
        for counted in (playable, returned)
    )
    names = [name for name, _ in by_speed], [name for name, _ in by_spin]
    title = "Playable balls of human play that come back"
    heat_map(path, title, "speed, m/s", "spin, rad/s", *names, hits / np.maximum(counts, 1), counts)


def _by_speed(balls: Serves) -> list[tuple[str, Mask]]:
    return _bins(np.linalg.norm(balls.vs_mps, axis=1), SPEED_EDGES_MPS)


def _by_spin(balls: Serves) -> list[tuple[str, Mask]]:
    return _bins(np.linalg.norm(balls.spins_radps, axis=1), SPIN_EDGES_RADPS)


def _bins(values: Array, edges: Sequence[float]) -> list[tuple[str, Mask]]:
    return [
        (f"from {low:g}" if high == np.inf else f"{low:g} to {high:g}", (low <= values) & (values < high))
        for low, high in itertools.pairwise(edges)
    ]


def _row_of(file: PlayedFile) -> Row:
    return summary_row(file.name, file.played, np.ones(len(file.balls), np.bool_))


def _joined(files: Sequence[PlayedFile]) -> PlayedFile:
    names = ("fate", "incoming", "is_service", "error_m")
    played = SimulatedReturns(*(np.concatenate([getattr(file.played, name) for file in files]) for name in names))
    return PlayedFile("all", join_serves([file.balls for file in files]), played)
