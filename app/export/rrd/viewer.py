"""Streaming to a Rerun viewer: a recording once, or a live rally continuously."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from app.export.frozen import freeze
from app.export.rrd.camera import PicturePool
from app.export.rrd.paths import APPLICATION
from app.export.rrd.recording import RallyWriter, RrdContents, blueprint_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, check_cancelled
from core.errors import CommandError
from core.live.ring_recording import RingRecording
from core.recordings import Recording
from core.recordings.layout import Rows
from core.text import encodable

CONNECT_S: Final = 4.0
FLUSH_S: Final = 20.0
"""A viewer that has not accepted one second of a rally after this long counts as lost."""
LIVE_PART_US: Final = 300_000
"""Length of the parts in which a live rally is sent."""
BEHIND_US: Final = 4_000_000
"""Parts older than this when they could be sent are skipped: the machine is too slow."""
WAIT_S: Final = 0.05


@contextmanager
def viewer_stream(
    address: str, blueprint: rrb.Blueprint, *, recording_id: str, name: str
) -> Iterator[tuple[rr.RecordingStream, Callable[[], None]]]:
    """The stream to a viewer at `rerun+http://HOST:PORT/proxy`, and a function that checks that it still accepts data.

    Raises:
        CommandError: if there is no viewer, or it is lost.
    """
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    stream.connect_grpc(address, default_blueprint=blueprint)
    try:
        stream.send_recording_name(encodable(name))
        _flush(stream, address, CONNECT_S, "no Rerun viewer answers")

        def check() -> None:
            _flush(stream, address, FLUSH_S, "the Rerun viewer is lost")

        yield stream, check
        check()
    finally:
        stream.disconnect()


def stream_recording(
    recording: Recording,
    address: str,
    span: Span,
    contents: RrdContents,
    *,
    name: str,
    groups: Callable[[str], Rows | None] = lambda group: None,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> None:
    """Send a span, the same data as its Rerun file.

    Raises:
        CommandError: if there is no viewer, or it is lost.
        ExportCancelledError: if `cancelled()` is true; the viewer keeps what it has.
    """
    blueprint = blueprint_of(recording, contents, groups)
    with viewer_stream(address, blueprint, recording_id=_identity(recording, span), name=name) as (stream, check):
        writer = RallyWriter(stream, recording, contents, groups, written=check)
        writer.begin()
        with PicturePool(writer.pictures_of(span)) as pool:
            writer.write(recording, span, pool, progress, cancelled)
    progress(1.0)


def stream_live(
    ring: RingRecording,
    address: str,
    contents: RrdContents,
    *,
    name: str,
    groups: Callable[[str], Rows | None] = lambda group: None,
    cancelled: Cancelled = lambda: False,
    skipped: Callable[[int], None] = lambda us: None,
) -> None:
    """Send a live rally from now on until `cancelled()` is true; `skipped` gets the total time left out.

    Raises:
        CommandError: if there is no viewer, or it is lost, or another session of the simulation began.
        ExportCancelledError: when `cancelled()` is true.
    """
    session, since_us, left_out_us = ring.uuid, ring.duration_us, 0
    blueprint = blueprint_of(ring, contents, groups)
    identity = f"{session}-live-{since_us}-{time.time_ns()}"
    with viewer_stream(address, blueprint, recording_id=identity, name=name) as (stream, check), PicturePool(0) as pool:
        writer = RallyWriter(stream, ring, contents, groups, written=check)
        writer.begin()
        while True:
            check_cancelled(cancelled)
            if ring.uuid != session:
                raise CommandError("the live rally began anew", remedy="stream it again")
            now_us = ring.duration_us
            if now_us - since_us < LIVE_PART_US:
                time.sleep(WAIT_S)
                continue
            if now_us - since_us > BEHIND_US:
                left_out_us += now_us - LIVE_PART_US - since_us
                since_us = now_us - LIVE_PART_US
                skipped(left_out_us)
                writer = RallyWriter(stream, ring, contents, groups, written=check)  # a chain that knows of no gap
            span = Span(since_us, now_us)
            writer.write(freeze(ring, span), span, pool, lambda share: None, cancelled)
            since_us = now_us


def _identity(recording: Recording, span: Span) -> str:
    """New recording id for each stream; with the same one a viewer would append."""
    return f"{recording.uuid}-{span.start_us}-{span.end_us}-{time.time_ns()}"


def _flush(stream: rr.RecordingStream, address: str, within_s: float, problem: str) -> None:
    try:
        stream.flush(timeout_sec=within_s)
    except RuntimeError as error:
        remedy = "start `rerun` there, and stream again"
        raise CommandError(problem, where=address, remedy=remedy) from error
