"""Live rallies go on and are forgotten: what is labelled or looked into is frozen into a recording first."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from app.background.jobs import LoopJob
from app.export.frozen import freeze, write_frozen
from app.export.selection import Span
from app.modes.mode import ModeHost
from core.errors import RecordingError
from core.live.ring_recording import RingRecording
from core.recordings import Recording

NEXT_BLOCK_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class FrozenPart:
    """A recording that was made of a live rally."""

    name: str
    uuid: str


class LiveCopy:
    """Freezes what a live rally remembers, once it is to stay. Methods are called by the loop."""

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._job = LoopJob[FrozenPart](host.later, self._failed)
        self._made: FrozenPart | None = None
        self._t_us = 0
        self._then: Callable[[], None] = _nothing

    @property
    def share(self) -> float | None:
        """How much is written, 0..1, until it is open; None: nothing is being frozen."""
        if self._job.share is None:
            return None if self._made is None else 1.0
        return self._job.share

    def begin(self, recording: RingRecording, t_us: int, step_us: int, then: Callable[[], None]) -> None:
        """Freeze it and open the recording, at the same moment as `t_us` is now; `then` is called once that is shown.

        Raises:
            RecordingError: if the moment is forgotten already.
        """
        if self.share is not None:
            return
        oldest_us = recording.start_us
        if not oldest_us <= t_us <= recording.duration_us:
            raise RecordingError("this moment of the live rally is no longer in memory", remedy="choose a later one")
        # The moment falls on a step, of those that are to be labelled.
        start_us = t_us - (t_us - oldest_us) // step_us * step_us
        claim = ExitStack()  # the name is told now, and free again when the job is over
        path = claim.enter_context(self._host.services.workspace.new_live_path())

        def work(progress: Callable[[float], None], cancelled: Callable[[], bool]) -> FrozenPart:
            span = Span(start_us, _end_us(recording, t_us, cancelled))
            frozen = freeze(recording, span)
            return FrozenPart(path.stem, write_frozen(frozen, span, path, progress=progress, cancelled=cancelled))

        self._t_us, self._then = t_us - start_us, then
        self._job.start(work, self._open, claim)
        seconds = (recording.duration_us - start_us) / 1e6
        self._host.note("Saving the live rally", f"Its last {seconds:.0f} s become the recording {path.stem}.", "blue")

    def moment_in(self, recording: Recording) -> int | None:
        """Where the cursor is to be, if this is the recording that was asked for."""
        return self._t_us if self._made is not None and recording.uuid == self._made.uuid else None

    def shown(self, recording: Recording, t_us: int) -> None:
        """This moment of a recording is on the screen."""
        if self.moment_in(recording) == t_us:
            then, self._then, self._made = self._then, _nothing, None
            then()

    def forget(self) -> None:
        """The person has gone elsewhere: the recording is still made, and nothing more."""
        self._then, self._made = _nothing, None

    def close(self) -> None:
        """The browser is gone."""
        self._job.close()

    def _open(self, made: FrozenPart) -> None:
        if self._then is not _nothing:
            self._made = made
            self._host.open_recording(made.name)

    def _failed(self, error: Exception) -> None:
        self.forget()
        self._host.report(error)


def _end_us(recording: RingRecording, t_us: int, cancelled: Callable[[], bool]) -> int:
    """Where the copy ends: after the moment, so that this is in it. The newest moment waits for the next block.

    Raises:
        RecordingError: if none comes.
    """
    until_s = time.monotonic() + NEXT_BLOCK_S
    while (end_us := recording.duration_us) <= t_us:
        if cancelled() or time.monotonic() > until_s:
            raise RecordingError("nothing came after this moment yet", remedy="press Run, or choose an earlier one")
        time.sleep(0.01)
    return end_us


def _nothing() -> None:
    """What is done after a freeze that nobody waits for."""
