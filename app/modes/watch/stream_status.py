"""Status of a live source as HTML."""

from __future__ import annotations

from typing import Final

from app import theme
from app.formatting import html_text
from app.modes.watch.figures import coloured, figures_html, latency_rows, learned_words, muted, percentiles_text
from core.devices.camera_feed import FeedCounts
from core.live.camera_source import CameraReport, CameraSource
from core.live.link.live_source import LiveSource
from core.live.live_snapshot import RallySnapshot
from core.live.stream_watch import CameraHealth, StreamHealth
from core.text import counted

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
    """Text of what a camera has lost since it was opened; empty if nothing."""
    message = []
    if counts.packets_dropped:
        message.append(f"{counted(counts.packets_dropped, 'USB packet')}: this machine was too busy to read them")
    elif counts.gaps:
        message.append(f"{counted(counts.gaps, 'gap')} in what the camera sent")
    if counts.events_given_up:
        message.append(f"{counted(counts.events_given_up, 'event')} that came too late")
    if counts.packets_refused:
        message.append(counted(counts.packets_refused, "invalid packet"))
    return "; ".join(message)


def _rate(rate_hz: float) -> str:
    for unit, name in ((1e6, "million "), (1e3, "thousand ")):
        if rate_hz >= unit:
            return f"{rate_hz / unit:.1f} {name}events/s"
    return f"{rate_hz:.0f} events/s"


def _clock(report: CameraReport, first: str, *, cable: bool) -> str:
    """Text of a camera's clock against this machine's, and how it is aligned with the first camera's."""
    clock = report.clock
    if clock is None:
        return "not known yet"
    message = f"{1e6 * clock.drift:+.1f} ppm against this machine, packets up to {1e-3 * clock.jitter_us:.1f} ms late"
    if first:
        message += f"; one with {first}'s, by cable" if cable else f"; shifted to {first}'s, no sync cable"
    if report.clock_restarts:
        message += f"; restarted {counted(report.clock_restarts, 'time')}"
    return message


KEPT: Final = 0.95
"""Share of the requested speed below which a warning is shown."""
ALONE: Final = (
    f"<div style='font-size:12px;color:{theme.MUTED};padding:4px 12px'>There is no robot and no ground truth: "
    "nothing is served or returned, and strokes are counted as seen by the cameras.</div>"
)


def stream_html(source: LiveSource, health: StreamHealth, snapshot: RallySnapshot, *, has_robot: bool = False) -> str:
    """HTML of a source that is not a simulation: connection, speed, cameras, and processing."""
    rows = [("Source", _source(source, health))]
    if source.behind_s > 0:
        rows.append(
            (
                "Behind",
                muted(f"{source.behind_s:.1f} s in all: this machine was busy, and events came later"),
            )
        )
    if health.blocks_lost:
        rows.append(("Lost blocks", coloured(theme.WARN, f"{health.blocks_lost:,} of 10 ms never came")))
    rows += camera_rows(health.cameras)
    if isinstance(source, CameraSource):
        rows += device_rows(source.reports(), cable=source.cable)
    if snapshot.problem:
        rows.append(("Not in space", coloured(theme.WARN, html_text(snapshot.problem))))
    else:
        followed = snapshot.health
        rows.append(("Followed", f"{followed.state_hz:.0f} times a second, {percentiles_text(followed.step)} each"))
        rows += latency_rows(followed)
        if snapshot.learned is not None:
            rows.append(("Air and table", learned_words(snapshot.learned)))
        if followed.blocks_dropped:
            live = isinstance(source, CameraSource)
            remedy = "It is too slow for these cameras" if live else "Ask for a lower speed"
            skipped = f"{counted(followed.blocks_dropped, 'block')} of 10 ms: this machine was busy"
            rows.append(("Skipped blocks", muted(f"{skipped}. A recording has them. Many? {remedy}")))
        rows += picture_rows(followed.pictures, followed.pictures_skipped)
    return figures_html(rows) + ("" if has_robot else ALONE)


def picture_rows(looked_at: int, skipped: int) -> list[tuple[str, str]]:
    """Rows of pictures of frame cameras; none where there are none."""
    rows = [("Pictures", f"{looked_at:,} looked at for the ball")] if looked_at or skipped else []
    if skipped:
        why = f"{skipped:,}: yolo is too slow for this speed here. A recording has them. Ask for a lower speed"
        rows.append(("Skipped pictures", muted(why)))
    return rows


def camera_rows(cameras: tuple[CameraHealth, ...]) -> list[tuple[str, str]]:
    """Rows of cameras with present or past problems; none for cameras that never missed a block."""
    rows = []
    for one in cameras:
        missing = f"{counted(one.blocks_missing, 'block')} of 10 ms never came"
        if one.lost:
            message = f"lost, no data for {one.absent_us / 1e6:.1f} s; {missing}. The rest continues"
            rows.append((html_text(one.name), coloured(theme.BAD, message)))
        elif one.silent:
            message = f"no events for {one.silent_us / 1e6:.1f} s: is it covered, or its file shorter than the other?"
            rows.append((html_text(one.name), coloured(theme.WARN, message)))
        elif one.blocks_missing:
            rows.append((html_text(one.name), muted(missing)))
    return rows


def _source(source: LiveSource, health: StreamHealth) -> str:
    name = html_text(source.description)
    if source.status == "lost":
        return coloured(theme.BAD, f"{name}, stopped. Restart Rallyscope")
    if health.stopped:
        return coloured(theme.BAD, f"{name}, no data for {health.quiet_s:.0f} s")
    asked = source.state.speed_factor if source.state is not None else 1.0
    if health.pace is None:
        return name
    if health.pace < KEPT * asked:
        message = f"{name}, only {health.pace:.2f} x real time instead of {asked:g}: this machine is busy"
        return coloured(theme.WARN, message)
    return coloured(theme.GOOD, f"{name}, {health.pace:.2f} x real time")
