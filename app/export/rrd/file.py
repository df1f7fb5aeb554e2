"""Writing a Rerun file under a temporary name; Rerun itself packs it at the end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from app.export.rrd.paths import APPLICATION
from app.export.unfinished import Cancelled, check_cancelled, unfinished_file
from core.errors import RecordingError


@contextmanager
def rerun_file(
    path: Path, blueprint: rrb.Blueprint, *, recording_id: str, overwrite: bool, cancelled: Cancelled
) -> Iterator[rr.RecordingStream]:
    """The stream to log to; at the end of the block it becomes the file. If the block raises, there is no file.

    Raises:
        CommandError: if the file exists and `overwrite` is not set, or it cannot be written.
        ExportCancelledError: if `cancelled()` is true.
    """
    with unfinished_file(path, overwrite=overwrite) as unfinished:
        raw = unfinished.with_name("raw.rrd")
        stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
        stream.save(raw, default_blueprint=blueprint)
        try:
            stream.send_recording_name(path.stem)
            yield stream
            stream.flush()
        finally:
            stream.disconnect()
        check_cancelled(cancelled)
        _optimize(raw, unfinished)
        check_cancelled(cancelled)


def _optimize(raw: Path, path: Path) -> None:
    """Let Rerun pack the file: fewer and larger chunks open faster."""
    command = [sys.executable, "-m", "rerun", "rrd", "optimize", str(raw), "-o", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not path.is_file():
        raise RecordingError("Rerun could not optimize its file", got=(done.stderr or done.stdout)[-300:])
