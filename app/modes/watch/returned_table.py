"""How many balls came back, by who played and in which scene, as HTML."""

from __future__ import annotations

from typing import Final

from app import theme
from app.formatting.file_text import html_text
from core.history.return_counts import ReturnRate

CELL: Final = "text-align:right;white-space:nowrap;padding-left:10px"


def returned_html(rates: tuple[ReturnRate, ...]) -> str:
    """A row for each controller and scene, with the 95 % interval of its share."""
    style = "font-size:12.5px;padding:2px 12px;line-height:1.45"
    if not rates:
        return f"<div style='{style};color:{theme.MUTED}'>No ball has been played to its end yet.</div>"
    rows = "".join(_row(rate) for rate in rates)
    left_out = "With 95 % intervals. A ball during which controller or scene changed is left out."
    note = f"<div style='color:{theme.MUTED}'>{left_out}</div>"
    return f"<div style='{style}'><table style='width:100%'>{rows}</table>{note}</div>"


def interval_text(rate: ReturnRate) -> str:
    """The interval in whole per cent."""
    low, high = rate.interval
    return f"{100 * low:.0f}–{100 * high:.0f} %"


def _row(rate: ReturnRate) -> str:
    who = html_text(rate.conditions.controller)
    where = html_text(rate.conditions.scene or "unknown scene")
    counted = f"<b>{rate.returned} of {rate.balls}</b>, {interval_text(rate)}"
    return f"<tr><td>{who} · {where}</td><td style='{CELL}'>{counted}</td></tr>"
