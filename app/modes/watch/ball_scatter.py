"""The balls as points of a picture: two columns of the index, coloured by a third; which point is at a place of the
picture, and which ones a line drawn in it encloses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting import html_text
from app.modes.watch.figures import muted
from app.pictures.palette import CLUSTER_COLOURS, PaletteIndex, palette

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.float64]
AXES: Final = {
    "speed, m/s": "speed_mps",
    "spin, rad/s": "spin_radps",
    "spin's sd, rad/s": "spin_sigma_radps",
    "height at the net, m": "net_z_m",
    "error, m": "error_m",
    "outcome": "outcome",
    "kind": "kind",
    "method": "method",
    "recording": "name",
    "source": "source",
    "labels": "labels",
    "ball": "number",
    "time, us": "t_us",
}
"""What can be drawn: what it is called, and its column."""
WIDTH_PX, HEIGHT_PX = 752, 500
"""Twice what a panel shows, for dense screens."""
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 92, 14, 34, 66
"""Margins round the points, with the numbers and names of the axes."""
LETTERS: Final = 0.75
"""Size of the letters, as OpenCV has it."""
REACH_PX: Final = 16
"""A click this near to a point is on it."""
SMALL: Final = 500
"""So few points are drawn larger."""
TICKS: Final = 5
NAMED: Final = 6
"""So many texts are named on an axis; of more, the first and the last."""
LONGEST_NAME: Final = 9
JITTER: Final = 0.6
"""Share of the place of a text over which its points are spread."""
SEED: Final = 49
FLOOR_RGB, LINE_RGB, TEXT_RGB, UNKNOWN_RGB = (24, 26, 31), (51, 54, 64), (166, 171, 181), (110, 112, 118)
DIMMED: Final = 0.25
"""Share of their colour that points outside of the selection keep."""


@dataclass(frozen=True, slots=True)
class ScatterAxes:
    """Names of columns of the index."""

    x: str = "speed_mps"
    y: str = "net_z_m"
    colour: str = "kind"


@dataclass(frozen=True, slots=True, eq=False)
class BallScatter:
    """A drawn picture and where its points are."""

    png: bytes
    rows: NDArray[np.int64]
    """(N,) rows of the index that are drawn: those whose x and y are known."""
    places_px: NDArray[np.int32]
    """(N, 2) in the picture."""
    legend: str
    """HTML: what the colours mean, and how many have no place."""


def draw_scatter(
    table: pa.Table, rows: NDArray[np.int64], axes: ScatterAxes, selected: NDArray[np.int64] | None = None
) -> BallScatter:
    """The points of these rows, those that are not selected pale.

    Args:
        table: the ball index.
        rows: (R,) rows of it.
        axes: what is drawn.
        selected: rows; None: all.
    """
    found = table.select(list(dict.fromkeys((axes.x, axes.y, axes.colour)))).take(rows)
    rng = np.random.default_rng(SEED)
    scales = [_scale(found, column, rng) for column in (axes.x, axes.y)]
    known = np.isfinite(scales[0].shares) & np.isfinite(scales[1].shares)
    inner = np.array([WIDTH_PX - LEFT_PX - RIGHT_PX, HEIGHT_PX - TOP_PX - BOTTOM_PX])
    shares = np.column_stack([scales[0].shares[known], 1 - scales[1].shares[known]])
    places_px = np.round(np.array([LEFT_PX, TOP_PX]) + shares * inner).astype(np.int32)
    rgb, colours = _colours(found, axes.colour)
    rgb, drawn = rgb[known].astype(np.float64), rows[known]
    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), FLOOR_RGB, np.uint8)
    _draw_axes(picture, scales, axes)
    order = rng.permutation(len(drawn))  # else the last recording would hide all others
    if selected is not None:
        is_pale = ~np.isin(drawn, selected)
        rgb[is_pale] = DIMMED * rgb[is_pale] + (1 - DIMMED) * np.array(FLOOR_RGB)
        order = order[np.argsort(~is_pale[order], kind="stable")]
    _draw_points(picture, places_px[order], rgb[order].astype(np.uint8))
    done, png = cv2.imencode(".png", picture[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    assert done
    lost = len(rows) - len(drawn)
    named = " or ".join(dict.fromkeys(title_of(axis).partition(",")[0] for axis in (axes.x, axes.y)))  # without units
    words = f"{lost:,} not drawn: {named} not known" if lost else ""
    legend = f"{colours}<div>{muted(html_text(words))}</div>" if words else colours
    return BallScatter(png.tobytes(), drawn, places_px, legend)


def title_of(column: str) -> str:
    """What a column is called."""
    return next(title for title, name in AXES.items() if name == column)


def row_at(scatter: BallScatter, x: float, y: float) -> int | None:
    """The row whose point is nearest to a place (shares of the picture's width and height); None if none is near."""
    if not len(scatter.rows):
        return None
    away = np.hypot(*(scatter.places_px - np.array([x * WIDTH_PX, y * HEIGHT_PX])).T)
    nearest = int(np.argmin(away))
    return int(scatter.rows[nearest]) if away[nearest] <= REACH_PX else None


def rows_within(scatter: BallScatter, outline: Sequence[tuple[float, float]]) -> NDArray[np.int64]:
    """Rows, ascending, whose points a closed line through these places encloses (shares of the picture's size)."""
    inside = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8)
    corners = np.round(np.array(outline).reshape(-1, 2) * np.array([WIDTH_PX, HEIGHT_PX])).astype(np.int32)
    cv2.fillPoly(inside, [corners.reshape(-1, 1, 2)], 1)
    return np.sort(scatter.rows[inside[scatter.places_px[:, 1], scatter.places_px[:, 0]] > 0])


@dataclass(frozen=True, slots=True, eq=False)
class _Scale:
    shares: Array
    """(N,) places 0..1 along the axis; NaN: not known."""
    ticks: tuple[tuple[float, str], ...]
    """Places with a number or a name."""


def _scale(table: pa.Table, name: str, rng: np.random.Generator) -> _Scale:
    values, texts = _values(table, name)
    if texts:
        spread = JITTER * (rng.random(len(values)) - 0.5)
        named = range(len(texts)) if len(texts) <= NAMED else (0, len(texts) - 1)
        ticks = tuple(((k + 0.5) / len(texts), _shortened(texts[k])) for k in named)
        return _Scale((values + 0.5 + spread) / len(texts), ticks)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    if high <= low:
        low, high = low - 0.5, high + 0.5
    low, high = low - 0.03 * (high - low), high + 0.03 * (high - low)  # no point on the very edge
    return _Scale(
        (values - low) / (high - low), tuple(((at - low) / (high - low), f"{at:g}") for at in _steps(low, high))
    )


def _values(table: pa.Table, name: str) -> tuple[Array, list[str]]:
    """(N,) numbers of a column, or ranks of its texts, NaN: not known; and the texts in order, none of numbers."""
    column = table.column(name).combine_chunks()
    if column.type != "string":
        return column.to_numpy(zero_copy_only=False).astype(np.float64), []
    coded = column.dictionary_encode()
    texts = coded.dictionary.to_pylist()
    ranks = np.append(np.argsort(np.argsort(np.array(texts, object))), np.nan)  # the last: not known
    return ranks[coded.indices.fill_null(-1).to_numpy()], sorted(texts)


def _steps(low: float, high: float) -> list[float]:
    """About `TICKS` round numbers within a range."""
    rough = (high - low) / TICKS
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= rough)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _colours(table: pa.Table, name: str) -> tuple[NDArray[np.uint8], str]:
    """(N, 3) RGB of each row, and what they mean, as HTML."""
    values, texts = _values(table, name)
    rgb = np.full((len(values), 3), UNKNOWN_RGB, np.uint8)
    known = np.isfinite(values)
    if texts:
        inks = palette("orange / blue")[PaletteIndex.CLUSTER : PaletteIndex.CLUSTER + CLUSTER_COLOURS]
        named = known & (values < CLUSTER_COLOURS)
        rgb[named] = inks[values[named].astype(int)]
        lines = [
            _swatch(theme.hex_colour((int(ink[0]), int(ink[1]), int(ink[2]))), text.replace("_", " "))
            for ink, text in zip(inks, texts, strict=False)
        ]
        rest = len(texts) - CLUSTER_COLOURS
        lines += [_swatch(theme.hex_colour(UNKNOWN_RGB), f"{rest:,} others")] if rest > 0 else []
    elif not known.any():
        lines = []
    else:
        low, high = float(values[known].min()), float(values[known].max())
        ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8), cv2.COLORMAP_VIRIDIS).reshape(-1, 3)[:, ::-1]
        rgb[known] = ramp[(255 * (values[known] - low) / max(high - low, 1e-12)).astype(int)]
        stops = ",".join(theme.hex_colour((int(r), int(g), int(b))) for r, g, b in ramp[::51])
        bar = f"background:linear-gradient(90deg,{stops});display:inline-block;width:90px;height:8px"
        lines = [f"{low:.4g} <span style='{bar}'></span> {high:.4g}"]
    lines += [] if known.all() else [_swatch(theme.hex_colour(UNKNOWN_RGB), "not known")]
    return rgb, f"<div>{html_text(title_of(name))}: {' '.join(lines)}</div>"


def _swatch(colour: str, text: str) -> str:
    box = f"<span style='background:{colour};display:inline-block;width:8px;height:8px;margin:0 3px 0 6px'></span>"
    return f"<span style='white-space:nowrap'>{box}{html_text(text, 24)}</span>"


def _draw_axes(picture: NDArray[np.uint8], scales: Sequence[_Scale], axes: ScatterAxes) -> None:
    right, bottom = WIDTH_PX - RIGHT_PX, HEIGHT_PX - BOTTOM_PX
    for share, text in scales[0].ticks:
        x = round(LEFT_PX + share * (right - LEFT_PX))
        cv2.line(picture, (x, TOP_PX), (x, bottom), LINE_RGB, 1)
        width = _text_width(text)
        _write(picture, text, min(x - width // 2, WIDTH_PX - width - 2), bottom + 26)
    for share, text in scales[1].ticks:
        y = round(bottom - share * (bottom - TOP_PX))
        cv2.line(picture, (LEFT_PX, y), (right, y), LINE_RGB, 1)
        _write(picture, text, max(LEFT_PX - 8 - _text_width(text), 0), y + 7)
    _write(picture, title_of(axes.y), 4, TOP_PX - 12)
    _write(picture, title_of(axes.x), right - _text_width(title_of(axes.x)), HEIGHT_PX - 12)


def _draw_points(picture: NDArray[np.uint8], places_px: NDArray[np.int32], rgb: NDArray[np.uint8]) -> None:
    radius = 6 if len(places_px) <= SMALL else 2
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if dx * dx + dy * dy <= radius * radius + 1:
                picture[places_px[:, 1] + dy, places_px[:, 0] + dx] = rgb


def _shortened(text: str) -> str:
    plain = text.replace("_", " ")
    return plain if len(plain) <= LONGEST_NAME else f"{plain[: LONGEST_NAME - 1]}."


def _text_width(text: str) -> int:
    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, LETTERS, 1)[0][0]


def _write(picture: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, LETTERS, TEXT_RGB, 1, cv2.LINE_AA)
