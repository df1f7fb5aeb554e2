"""How many balls of human play the simulated robot returns, by speed and by spin: rows, and a page with a picture."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.bench.heat_map import heat_map
from core.bench.learning.tables import binomial_interval, table
from core.bench.rally.simulated_returns import ReturnOutcome, SimulatedReturns, SimulatedReturnsConfig
from core.physics.episode import Serves
from core.simulation.episodes.incoming import Incoming

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
    """The balls of one file and what came of them."""

    name: str
    balls: Serves
    played: SimulatedReturns


def summary_row(name: str, played: SimulatedReturns, which: Mask) -> Row:
    """Counts, and the share of the playable balls that came back, with its 95 % interval."""
    balls, playable = int(which.sum()), int((which & (played.fate != ReturnOutcome.NOT_PLAYABLE)).sum())
    returned = int((which & (played.fate == ReturnOutcome.RETURNED)).sum())
    low, high = binomial_interval(returned / playable, playable) if playable else (float("nan"), float("nan"))
    errors = 1e3 * played.error_m[which & (played.fate == ReturnOutcome.RETURNED)]
    return {
        "balls": name,
        "count": balls,
        "playable": playable,
        "returned": returned,
        "share": returned / playable if playable else None,
        "low": low if playable else None,
        "high": high if playable else None,
        "error_mm_median": float(np.median(errors)) if len(errors) else None,
        "error_mm_p95": float(np.percentile(errors, 95)) if len(errors) else None,
    }


def losses(played: SimulatedReturns) -> dict[str, int]:
    """How many balls were lost to what; what lost none is left out."""
    found = {words: int((played.incoming == kind).sum()) for kind, words in INCOMING_WORDS.items()}
    found |= {words: played.count(fate) for fate, words in FATE_WORDS.items()}
    return {words: count for words, count in found.items() if count}


def report_rows(files: Sequence[PlayedFile]) -> dict[str, list[Row]]:
    """Rows by file, by speed at the state and by spin there."""
    whole = _joined(files)
    speeds, spins = _speeds(whole.balls), _spins(whole.balls)
    return {
        "files": [summary_row(file.name, file.played, np.ones(len(file.balls), np.bool_)) for file in files],
        "speeds": [summary_row(f"{name} m/s", whole.played, which) for name, which in _bins(speeds, SPEED_EDGES_MPS)],
        "spins": [summary_row(f"{name} rad/s", whole.played, which) for name, which in _bins(spins, SPIN_EDGES_RADPS)],
    }


def write_ball_states_report(
    path: Path, files: Sequence[PlayedFile], config: SimulatedReturnsConfig, command: str
) -> None:
    """The page, and its picture in `images/` beside it."""
    whole, rows = _joined(files), report_rows(files)
    rows["all"] = [summary_row("all", whole.played, np.ones(len(whole.balls), np.bool_))]
    images = path.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    (images / f"{path.stem}.svg").write_text(_picture(whole), encoding="utf-8")
    lost = {file.name: losses(file.played) for file in files}
    path.write_text(_page(rows, lost, config, command, f"images/{path.stem}.svg"), encoding="utf-8")


_TITLES: Final = (
    "balls",
    "count",
    "playable",
    "returned",
    "of the playable, % [95 %]",
    "off the target, mm, median / 95 %",
)


def _page(
    rows: dict[str, list[Row]],
    lost: dict[str, dict[str, int]],
    config: SimulatedReturnsConfig,
    command: str,
    picture: str,
) -> str:
    files = rows["files"] + (rows["all"] if len(rows["files"]) > 1 else [])
    parts = [
        "# Balls of human play against the simulated robot\n",
        f"Made by `{command}`.\n",
        *(f"{textwrap.fill(text, 118)}\n" for text in (_about_balls(rows["all"][0], config), _about_robot(config))),
        table(_TITLES, [_cells(row) for row in files]),
        "## By speed where the state begins\n",
        table(_TITLES, [_cells(row) for row in rows["speeds"]]),
        "## By spin there\n",
        table(_TITLES, [_cells(row) for row in rows["spins"]]),
        f"![returned by speed and spin]({picture})\n",
        "## What the others were lost to\n",
        _loss_table(lost),
    ]
    return "\n".join(parts)


def _about_balls(row: Row, config: SimulatedReturnsConfig) -> str:
    told = f"{config.told_after_ms:g} ms after the launch" if config.told_after_ms else "at the launch"
    return (
        "The files hold states of balls in human play: position, velocity and spin. Each is launched as it is. "
        f"Of {row['count']:,} balls {row['playable']:,} are playable: they bounce once on the robot's half (a service "
        f"on the other half first) and come to the hitting plane, x = {config.task.stroke.hit_plane_x_m:g} m. "
        f"**{row['returned']:,} come back.** The built-in controller plays with perfect knowledge: {told} it is told "
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


def _cells(row: Row) -> list[str]:
    def number(key: str, form: str, scale: int = 1) -> str:
        value = row[key]
        return format(scale * value, form) if isinstance(value, (int, float)) else "-"

    share = f"{number('share', '.1f', 100)} [{number('low', '.1f', 100)}, {number('high', '.1f', 100)}]"
    off = f"{number('error_mm_median', '.1f')} / {number('error_mm_p95', '.0f')}"
    return [str(row["balls"]), *(number(key, ",") for key in ("count", "playable", "returned")), share, off]


def _loss_table(lost: dict[str, dict[str, int]]) -> str:
    words = [
        one for one in (*INCOMING_WORDS.values(), *FATE_WORDS.values()) if any(one in each for each in lost.values())
    ]
    rows = [[one, *(f"{each.get(one, 0):,}" for each in lost.values())] for one in words]
    return table(("", *lost), rows)


def _picture(whole: PlayedFile) -> str:
    by_speed = _bins(_speeds(whole.balls), SPEED_EDGES_MPS)
    by_spin = _bins(_spins(whole.balls), SPIN_EDGES_RADPS)
    playable, returned = whole.played.fate != ReturnOutcome.NOT_PLAYABLE, whole.played.fate == ReturnOutcome.RETURNED
    counts = np.array([[(playable & a & b).sum() for _, a in by_speed] for _, b in by_spin])
    hits = np.array([[(returned & a & b).sum() for _, a in by_speed] for _, b in by_spin])
    return heat_map(
        "Playable balls of human play that come back",
        "speed, m/s",
        "spin, rad/s",
        [name for name, _ in by_speed],
        [name for name, _ in by_spin],
        hits / np.maximum(counts, 1),
        counts,
    )


def _bins(values: Array, edges: Sequence[float]) -> list[tuple[str, Mask]]:
    named = []
    for low, high in itertools.pairwise(edges):
        name = f"from {low:g}" if high == np.inf else f"{low:g} to {high:g}"
        named.append((name, (low <= values) & (values < high)))
    return named


def _speeds(balls: Serves) -> Array:
    return np.linalg.norm(balls.vs_mps, axis=1)


def _spins(balls: Serves) -> Array:
    return np.linalg.norm(balls.spins_radps, axis=1)


def _joined(files: Sequence[PlayedFile]) -> PlayedFile:
    balls = Serves(*(np.concatenate([getattr(f.balls, k) for f in files]) for k in ("ps_m", "vs_mps", "spins_radps")))
    names = ("fate", "incoming", "is_service", "error_m")
    played = SimulatedReturns(*(np.concatenate([getattr(file.played, name) for file in files]) for name in names))
    return PlayedFile("all", balls, played)
