"""The balls in Watch: what of the index is shown, as points and as a page of a table, with links to its moments."""

from __future__ import annotations

import base64
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting import html_text, with_dashes_explained
from app.modes.watch.ball_scatter import BallScatter, ScatterAxes, draw_scatter, title_of
from app.modes.watch.figures import muted
from app.shared.ball_index import BallIndex, BallSource
from core.text import counted

ROWS: Final = 12
"""Rows of a page."""
LONGEST_NAME: Final = 18
TITLES: Final = ("ball", "m/s", "rad/s", "net, m", "")


@dataclass(frozen=True, slots=True, eq=False)
class BallQuery:
    """What a person wants to see of the index."""

    index: BallIndex
    conditions: str
    axes: ScatterAxes = field(default_factory=ScatterAxes)
    selected: NDArray[np.int64] | None = None
    """Rows that a line was drawn round; None: there is no line."""
    first: int = 0
    """Row that the table begins with, of those that are shown."""
    mode: str = "Watch"
    """Where a click shows the moment."""
    name_of: Callable[[BallSource], str] = lambda source: source.name
    """Name of a recording in the list of recordings."""


@dataclass(frozen=True, slots=True, eq=False)
class BallView:
    """What is shown of it."""

    rows: NDArray[np.int64]
    """Rows of the index: those that meet the conditions, and of them the selected ones where there are any."""
    first: int
    scatter: BallScatter
    count: str
    """HTML, as the next."""
    table: str


def view_balls(request: BallQuery) -> BallView:
    """The points, the number and a page of the balls.

    Raises:
        ConfigError: if a condition is none.
    """
    from labels.balls.table import parse_conditions, select_rows  # late: pyarrow may be missing, see `index_balls`

    index = request.index
    met = select_rows(index.table, parse_conditions(request.conditions))
    rows = met if request.selected is None else np.intersect1d(met, request.selected)
    first = min(max(request.first, 0), (max(len(rows), 1) - 1) // ROWS * ROWS)
    shown = rows[first : first + ROWS]
    page = index.table.take(shown).to_pylist()
    links = [link_of_row(request, row) for row in shown.tolist()]
    scatter = draw_scatter(index.table, met, request.axes, request.selected)
    return BallView(rows, first, scatter, count_html(index, len(rows), first), balls_html(page, links))


def selection_text(request: BallQuery) -> str:
    """How the shown balls were selected, in words for those who get a data set of them."""
    how = [f"conditions {request.conditions.strip()}"] if request.conditions.strip() else []
    if request.selected is not None:
        axes = request.axes
        how.append(f"a line drawn round points ({title_of(axes.x)} across, {title_of(axes.y)} up)")
    return " and ".join(how) or "all balls"


def link_of_row(request: BallQuery, row: int) -> str | None:
    """Link to the moment of a row of the index; None for a ball of a run, which has none."""
    source, t_us = request.index.source_of(row), request.index.table.column("t_us")[row].as_py()
    return None if t_us is None or source.kind == "run" else moment_link(request.name_of(source), request.mode, t_us)


def scatter_html(view: BallView) -> str:
    """The picture of the points with its legend; `balls.js` sends what a hand does on it."""
    picture = base64.b64encode(view.scatter.png).decode()
    words = "Points of the balls in the list below. Click: open the moment. Drag: select; with Shift: select more"
    return (
        f"<div style='padding:2px 12px;font-size:12px;line-height:1.45'><img data-rallyscope-balls alt='{words}' "
        f"title='{words}' draggable='false' style='width:100%;display:block;cursor:crosshair;touch-action:none' "
        f"src='data:image/png;base64,{picture}'>{view.scatter.legend}</div>"
    )


def moment_link(recording: str, mode: str, t_us: int) -> str:
    """What stands behind the # of an address that shows a moment of a recording of the library in a mode.

    It has no version: so it names no settings, and changes none.
    """
    return urllib.parse.urlencode({"recording": recording, "mode": mode, "t": t_us})


def balls_html(rows: Sequence[Mapping[str, object]], links: Sequence[str | None]) -> str:
    """A row per ball: what and when, speed, spin with its uncertainty, height at the net, outcome.

    The first is a link to its moment; a ball of a run has none.
    """
    head = "".join(f"<th style='text-align:left;font-weight:400;color:{theme.MUTED}'>{title}</th>" for title in TITLES)
    lines = "".join(f"<tr>{_cells(row, link)}</tr>" for row, link in zip(rows, links, strict=True))
    table = f"<table style='width:100%;border-spacing:0'><tr>{head}</tr>{lines}</table>"
    shown = with_dashes_explained(table, "not known of this ball")
    return f"<div style='font-size:12px;margin:2px 12px;line-height:1.4'>{shown}</div>"


def count_html(found: BallIndex, selected: int, first: int) -> str:
    """How many balls are selected, which are shown, and what is not in the list."""
    shown = f", {first + 1:,} to {min(first + ROWS, selected):,} shown" if selected else ""
    lines = [f"<b>{selected:,}</b> of {counted(len(found.table), 'row')}{shown}"]
    if found.unknown:
        lines.append(muted(f"{len(found.unknown):,} recordings say nothing of their balls"))
    lines += [muted(html_text(f"not read: {text}")) for text in list(found.failed.values())[:3]]
    return f"<div style='font-size:12.5px;padding:2px 12px;line-height:1.45'>{'<br>'.join(lines)}</div>"


def _cells(row: Mapping[str, object], link: str | None) -> str:
    t_us, kind = row["t_us"], html_text(str(row["kind"]))
    when = f"{t_us / 1e6:.6f} s" if isinstance(t_us, int) else f"ball {row['number']}"
    what = f"{kind} {when}"
    if link is not None:
        what = f"<a href='#{html_text(link, len(link))}' style='color:#ffb066'>{what}</a>"
    name = muted(html_text(str(row["name"]), LONGEST_NAME))
    spin, sigma = _figure(row["spin_radps"], 0), row["spin_sigma_radps"]
    spin += f" &plusmn; {sigma:.0f}" if isinstance(sigma, float) and sigma > 0 else ""
    outcome = html_text(str(row["outcome"] or "").replace("_", " "))
    cells = (f"{what}<br>{name}", _figure(row["speed_mps"], 2), spin, _figure(row["net_z_m"], 2), outcome)
    return "".join(f"<td style='vertical-align:top;padding-right:6px'>{cell}</td>" for cell in cells)


def _figure(value: object, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, float) else "-"
