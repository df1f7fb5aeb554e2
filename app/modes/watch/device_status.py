"""How event cameras are doing, in plain words, as rows of HTML: their rate, their clock, and what was lost."""

from __future__ import annotations

from app import theme
from app.formatting.file_text import html_text
from app.modes.watch.figures import coloured
from core.devices.camera_feed import FeedCounts
from core.live.camera_source import CameraReport

Rows = list[tuple[str, str]]


def device_rows(reports: tuple[CameraReport, ...], *, cable: bool) -> Rows:
    """Status rows of all cameras; the clock of the first camera is the session's."""
    rows: Rows = []
    for number, one in enumerate(reports):
        name = html_text(one.name)
        if one.problem:
            rows.append((name, coloured(theme.BAD, f"gone. {html_text(one.problem)}")))
            continue
        rows.append((name, f"{html_text(one.model)} {html_text(one.serial)}, {_rate(one.rate_hz)}"))
        rows.append((f"Clock of {name}", _clock(one, html_text(reports[0].name) if number else "", cable=cable)))
        lost = lost_words(one.counts)
        if lost:
            rows.append((f"Lost of {name}", coloured(theme.WARN, lost)))
    return rows


def lost_words(counts: FeedCounts) -> str:
    """What is missing of a camera since it was opened; empty if nothing is."""
    said = []
    if counts.packets_dropped:
        said.append(f"{counts.packets_dropped:,} USB packets: this machine was too busy to read them")
    elif counts.gaps:
        said.append(f"{counts.gaps:,} gaps in what the camera sent")
    if counts.events_given_up:
        said.append(f"{counts.events_given_up:,} events that came too late")
    if counts.packets_refused:
        said.append(f"{counts.packets_refused:,} packets that make no sense")
    return "; ".join(said)


def _rate(rate_hz: float) -> str:
    for unit, name in ((1e6, "million "), (1e3, "thousand ")):
        if rate_hz >= unit:
            return f"{rate_hz / unit:.1f} {name}events/s"
    return f"{rate_hz:.0f} events/s"


def _clock(report: CameraReport, first: str, *, cable: bool) -> str:
    """Against this machine's, and how it is brought onto the first camera's."""
    clock = report.clock
    if clock is None:
        return "not known yet"
    said = f"{1e6 * clock.drift:+.1f} ppm against this machine, packets up to {1e-3 * clock.jitter_us:.1f} ms late"
    if first:
        said += f"; one with {first}'s, by cable" if cable else f"; shifted to {first}'s, which no cable joins"
    if report.clock_restarts:
        said += f"; found anew {report.clock_restarts} times"
    return said
