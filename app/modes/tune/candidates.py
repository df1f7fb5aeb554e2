"""Below the picture in Tune: every cluster that was found, and why it is not a ball."""

from __future__ import annotations

import html

import viser

from app import theme
from app.modes.tune.settings import stage_counts_html
from app.pictures.palette import palette
from app.views.stage_picture import cluster_ink
from core.detection import Candidate, PipelineTrace

LISTED = 40


class CandidatesTable:
    """A table of the clusters, the ball first, then by size."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._table = gui.add_html(stage_counts_html("no window yet"))

    def show(self, traces: tuple[tuple[str, PipelineTrace], ...], seconds: float) -> None:
        """The clusters of each config's trace."""
        self._table.content = "".join(candidates_html(name if len(traces) > 1 else "", t) for name, t in traces) + (
            stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms")
        )


def candidates_html(name: str, trace: PipelineTrace) -> str:
    """One config's clusters."""
    found = trace.detection
    verdict = (
        f"<b style='color:{theme.GOOD}'>ball at ({found.u_px:.1f}, {found.v_px:.1f}), radius {found.r_px:.1f} px</b>"
        if found
        else f"<b style='color:{theme.BAD}'>no ball</b>"
    )
    where = "searched in the ROI" if trace.roi else "searched on the whole sensor"
    ordered = sorted(trace.candidates, key=lambda one: (one.rejected is not None, -one.size))
    titles = ("", "cluster", "events", "leads", "circularity", "solidity", "radius [px]", "verdict")
    head = "".join(f"<th style='text-align:left;font-weight:500;color:{theme.MUTED}'>{title}</th>" for title in titles)
    rows = "".join(_row(candidate) for candidate in ordered[:LISTED])
    more = f"<div>and {len(ordered) - LISTED} smaller ones</div>" if len(ordered) > LISTED else ""
    label = f"Config {html.escape(name)}: " if name else ""
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{label}{verdict} &middot; {where} &middot; "
        f"{len(ordered)} clusters<table style='width:100%'><tr>{head}</tr>{rows}</table>{more}</div>"
    )


def _row(candidate: Candidate) -> str:
    red, green, blue = palette("orange / blue")[cluster_ink(candidate.label)]
    swatch = f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span>"
    shape, circle = candidate.shape, candidate.circle
    verdict = (
        f"<span style='color:{theme.BAD}'>{html.escape(candidate.rejected)}</span>"
        if candidate.rejected
        else f"<span style='color:{theme.GOOD}'>ball</span>"
    )
    cells = (
        swatch, candidate.label, candidate.size, "ON" if candidate.leading_on else "OFF",
        f"{shape.circularity:.2f}" if shape else "-", f"{shape.solidity:.2f}" if shape else "-",
        f"{circle.r_px:.1f}" if circle else "-", verdict,
    )  # fmt: skip
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
