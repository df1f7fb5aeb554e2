"""A small line chart as SVG text: mean lines with a band for the spread over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 720, 380
LEFT, RIGHT, TOP, BOTTOM = 62, 170, 34, 46
COLOURS = ("#e8590c", "#1c7ed6", "#2f9e44", "#9c36b5", "#f08c00", "#0c8599", "#868e96", "#c2255c")
TICKS = 6


@dataclass(frozen=True, slots=True)
class ChartLine:
    """One method: mean and a band at each x."""

    name: str
    x: Sequence[float]
    mean: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]


def line_chart(
    title: str, x_title: str, y_title: str, lines: Sequence[ChartLine], *, y_top: float | None = None
) -> str:
    """The chart as an SVG document; values above `y_top` are cut off at the frame."""
    x_max = max((max(line.x) for line in lines if line.x), default=1.0)
    y_max = y_top or 1.05 * max((max(line.high) for line in lines if line.high), default=1.0)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"',
        ' font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        f'<text x="{LEFT}" y="20" font-size="14" font-weight="bold" fill="#212529">{escape(title)}</text>',
        *_axes(x_max, y_max, x_title, y_title),
    ]
    for k, line in enumerate(lines):
        parts += _line(line, COLOURS[k % len(COLOURS)], x_max, y_max)
        y = TOP + 12 + 18 * k
        x = WIDTH - RIGHT + 14
        parts.append(f'<rect x="{x}" y="{y - 8}" width="14" height="4" fill="{COLOURS[k % len(COLOURS)]}"/>')
        parts.append(f'<text x="{x + 20}" y="{y - 2}" fill="#212529">{escape(line.name)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _place(x: float, y: float, x_max: float, y_max: float) -> tuple[float, float]:
    px = LEFT + (WIDTH - LEFT - RIGHT) * x / x_max
    py = HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * min(max(y, 0.0), y_max) / y_max
    return round(px, 1), round(py, 1)


def _axes(x_max: float, y_max: float, x_title: str, y_title: str) -> list[str]:
    parts = []
    for k in range(TICKS):
        share = k / (TICKS - 1)
        x, bottom = _place(share * x_max, 0, x_max, y_max)
        _, y = _place(0, share * y_max, x_max, y_max)
        parts.append(f'<line x1="{LEFT}" y1="{y}" x2="{WIDTH - RIGHT}" y2="{y}" stroke="#dee2e6"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4}" text-anchor="end" fill="#495057">{share * y_max:.0f}</text>')
        parts.append(f'<text x="{x}" y="{bottom + 18}" text-anchor="middle" fill="#495057">{share * x_max:.0f}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle" fill="#495057">{escape(x_title)}</text>')
    centre = (TOP + HEIGHT - BOTTOM) / 2
    turn = f"rotate(-90 16 {centre})"
    parts.append(
        f'<text x="16" y="{centre}" text-anchor="middle" transform="{turn}" fill="#495057">{escape(y_title)}</text>'
    )
    return parts


def _line(line: ChartLine, colour: str, x_max: float, y_max: float) -> list[str]:
    def points(ys: Sequence[float]) -> list[str]:
        return [
            f"{px},{py}" for px, py in (_place(x, y, x_max, y_max) for x, y in zip(line.x, ys, strict=True) if y == y)
        ]

    band = " ".join(points(line.low) + points(line.high)[::-1])
    return [
        f'<polygon points="{band}" fill="{colour}" opacity="0.15"/>',
        f'<polyline points="{" ".join(points(line.mean))}" fill="none" stroke="{colour}" stroke-width="2"/>',
    ]
