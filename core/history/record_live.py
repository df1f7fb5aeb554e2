"""Records the live rally to a normal recording file."""

from __future__ import annotations

import queue
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from core.chain.chain import ChainState
from core.chain.control.controller import RacketDecision
from core.chain.control.hit_choice import HitChoice
from core.chain.control.player import PlayerState
from core.errors import LinkError, RallyscopeError, RecordingError
from core.history.recorded_rally import (
    EPISODES,
    HIT_CHOICES,
    PREDICTIONS,
    RACKET,
    SCENES_SEEN,
    TARGETS,
    Rows,
    choice_rows,
    episode_rows,
    prediction_rows,
    racket_rows,
    scene_rows,
    target_rows,
)
from core.live.link import messages as m
from core.live.link.live_source import LiveSource
from core.live.live_player import LivePlayer
from core.recordings import BallTruth, PixelTruth, RecordingWriter
from core.text import counted


class LiveRows:
    """Groups that grow at the end, with old rows dropped. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parts: dict[str, deque[tuple[int, Rows]]] = {}
        self._last: RacketDecision | None = None
        self._choice: HitChoice | None = None

    def clear(self) -> None:
        """Clear all rows."""
        with self._lock:
            self._parts.clear()
            self._last = self._choice = None

    def read_rows(self, group: str) -> Rows | None:
        """All columns of a group, as of a recording in a file; None while there are no rows."""
        with self._lock:
            parts = [rows for _, rows in self._parts.get(group, ())]
        return {name: np.concatenate([rows[name] for rows in parts]) for name in parts[0]} if parts else None

    def add_state(self, state: m.WorldState) -> None:
        """Add the racket's poses of a state."""
        self._add(RACKET, state.t_us, racket_rows(state, 0))

    def add_step(self, state: PlayerState, decision: RacketDecision | None) -> None:
        """Add the prediction and decision of a step."""
        if state.chain.is_new:
            self._add(PREDICTIONS, state.chain.t_us, prediction_rows(state.chain, 0))
        if state.choice is not None and state.choice is not self._choice:
            self._choice = state.choice
            self._add(HIT_CHOICES, state.choice.t_us, choice_rows(state.choice, 0))
        if decision is not None:
            self._last = decision
            self._add(TARGETS, decision.t_us, target_rows(decision, 0))

    def add_outcome(self, notice: m.OutcomeNotice, policy: str) -> None:
        """Add the outcome of a ball."""
        last = self._last
        decision = last if last is not None and notice.serve_us <= last.t_us <= notice.t_us else None
        self._add(EPISODES, notice.t_us, episode_rows(notice, decision, policy, 0))

    def forget_before(self, t_us: int) -> None:
        """Drop old rows."""
        with self._lock:
            for parts in self._parts.values():
                while parts and parts[0][0] < t_us:
                    parts.popleft()

    def _add(self, group: str, t_us: int, rows: Rows | None) -> None:
        if rows is not None:
            with self._lock:
                self._parts.setdefault(group, deque()).append((t_us, rows))


QUEUE: Final = 3000
"""Messages that may wait for the disk, about ten seconds."""
WAITING_BYTES: Final = 500_000_000
"""Pictures that may wait for the disk: packing one of 1280x720 in colour takes longer than some cameras take for it."""
FLUSH_BLOCKS: Final = 100


@dataclass(frozen=True, slots=True, eq=False)
class _Thought:
    """Prediction and decision of the player."""

    chain: ChainState
    decision: RacketDecision | None
    choice: HitChoice | None


_Message = m.EventBatch | m.PictureMessage | m.WorldState | m.OutcomeNotice | _Thought
_QueueItem = _Message | None


class LiveRecorder:
    """Records from the next whole block until `stop`, or until the session ends. Time starts at 0 again."""

    def __init__(
        self,
        source: LiveSource,
        path: Path,
        *,
        player: LivePlayer | None = None,
        from_start: bool = False,
        overwrite: bool = False,
    ) -> None:
        """Begin. With a player, its predictions and decisions are recorded too.

        `from_start`: the source begins at its time 0 because of this recorder, so its first block is whole.

        Raises:
            RecordingError: if the file exists and `overwrite` is not set, or it cannot be made.
        """
        self.path = Path(path)
        self.error: RallyscopeError | None = None
        """What ended the recording early; what was written until then is kept."""
        welcome = source.welcome
        self._source, self._session, self._seed = source, welcome.session, welcome.seed
        sensors = {info.name: info.sensor for info in welcome.cameras}
        pictures_only = [info.name for info in welcome.frame_cameras if info.name not in sensors]
        for info in welcome.frame_cameras:  # one that takes its pictures through an event camera's lens has its name
            sensors.setdefault(info.name, info.sensor)
        calibration = welcome.calibrated_frame_cameras() | welcome.calibrated()
        config = {"source": source.description, "session": welcome.session}
        self._names = tuple(sensors)
        self._writer = RecordingWriter(
            self.path,
            sensors,
            calibration=calibration,
            seed=welcome.seed,
            config=config,
            overwrite=overwrite,
            frame_cameras=pictures_only,
        )
        self._player = player
        self._decision: RacketDecision | None = None  # the writer's thread only
        self._choice: HitChoice | None = None  # the writer's thread only
        self._scene: str | None = None  # the writer's thread only
        self._zero_us: int | None = 0 if from_start else None
        self._blocks = 0
        self._counting = threading.Lock()
        self._waiting_bytes = self._left_out = 0
        self._items: queue.Queue[_QueueItem] = queue.Queue(QUEUE)
        self._ending = False
        self._thread = threading.Thread(target=self._write, name="live-recorder", daemon=True)
        self._thread.start()
        source.add_listener(self)
        if player is not None:
            player.add_listener(self._on_snapshot)

    @property
    def recording(self) -> bool:
        """Whether it is still recording."""
        return self._thread.is_alive() and not self._ending

    @property
    def duration_us(self) -> int:
        """What has been recorded so far, in the recording's own time; less than the wall time if that runs slower."""
        return self._writer.duration_us

    def stop(self) -> int:
        """Finish the file; returns its duration in microseconds. A note says how many pictures are not in it.

        Raises:
            RecordingError: if it could not be written to its end.
        """
        self._source.remove_listener(self)
        if self._player is not None:
            self._player.remove_listener(self._on_snapshot)
        self._end()
        self._thread.join()
        if self.error is not None:
            raise RecordingError(str(self.error), where=self.path) from self.error
        return self._writer.duration_us

    def on_session(self, welcome: m.Reply) -> None:
        """Another session is another recording."""
        if welcome.session != self._session:
            self._end()

    def on_events(self, batch: m.EventBatch) -> None:
        """Queue the batch."""
        self._queue(batch)

    def on_picture(self, picture: m.PictureMessage) -> None:
        """Queue the picture, unless too much waits for the disk already: then it is left out, and a note says so."""
        if self._ending or self._waiting_bytes > WAITING_BYTES:
            self._left_out += not self._ending
            return
        with self._counting:
            self._waiting_bytes += picture.pixels.nbytes
        self._queue(picture)

    def on_state(self, state: m.WorldState) -> None:
        """Queue the state, unless it is only a heartbeat."""
        if state.ends_block:
            self._queue(state)

    def on_notice(self, notice: m.Notice) -> None:
        """Outcomes become episodes."""
        if isinstance(notice, m.OutcomeNotice):
            self._queue(notice)

    def _on_snapshot(self, session: str, state: PlayerState, decision: RacketDecision | None) -> None:
        if session == self._session and state.chain.prediction is not None:
            self._queue(_Thought(state.chain, decision, state.choice))

    def _queue(self, message: _QueueItem) -> None:
        if self._ending:
            return
        try:
            self._items.put_nowait(message)
        except queue.Full:
            self.error = LinkError("the disk is too slow for the live rally", where=self.path)
            self._ending = True

    def _end(self) -> None:
        if not self._ending:
            self._ending = True
            self._items.put(None)

    def _write(self) -> None:
        try:
            with self._writer:
                while True:
                    try:
                        message = self._items.get(timeout=0.5)
                    except queue.Empty:
                        if self._ending:
                            break
                        continue
                    if message is None:
                        break
                    self._write_one(message)
                    if isinstance(message, m.PictureMessage):
                        with self._counting:
                            self._waiting_bytes -= message.pixels.nbytes
                if self._left_out:
                    left_out = f"{counted(self._left_out, 'picture')} of frame cameras left out"
                    self._writer.note(f"{left_out}: they came faster than they could be written.")
        except RallyscopeError as error:
            self.error = self.error or error
            self._ending = True

    def _write_one(self, message: _Message) -> None:
        if self._zero_us is None:
            if not isinstance(message, m.WorldState):  # the first state ends the block that was joined in its middle
                return
            self._zero_us = message.t_us
            return
        if isinstance(message, m.EventBatch):
            self._write_events(message, self._zero_us)
        elif isinstance(message, m.PictureMessage):
            self._writer.write_frame(message.camera, message.frame(), self._zero_us)
        elif isinstance(message, m.WorldState):
            self._write_state(message, self._zero_us)
        elif isinstance(message, _Thought):
            self._write_thought(message, self._zero_us)
        elif message.serve_us >= self._zero_us:
            last = self._decision
            made = last if last is not None and message.serve_us <= last.t_us <= message.t_us else None
            policy = "live" if self._player is None else self._player.controller.name
            self._writer.append_rows(EPISODES, episode_rows(message, made, policy, self._zero_us))

    def _write_thought(self, thought: _Thought, zero_us: int) -> None:
        choice, known = thought.choice, self._choice
        if choice is not None and choice is not known and choice.t_us >= zero_us:
            self._choice = choice
            found = choice_rows(choice, zero_us)
            if found is not None:
                self._writer.append_rows(HIT_CHOICES, found)
        rows = prediction_rows(thought.chain, zero_us, self._names)
        if rows is None or rows["t_us"][0] < 0:
            return
        self._writer.append_rows(PREDICTIONS, rows)
        if thought.decision is not None:
            self._decision = thought.decision
            self._writer.append_rows(TARGETS, target_rows(thought.decision, zero_us))

    def _write_events(self, batch: m.EventBatch, zero_us: int) -> None:
        events, truth = batch.events(), batch.truth()
        columns = (events.x_px, events.y_px, events.on, events.sensor)
        self._writer.append(batch.camera, type(events).from_columns(events.t_us - zero_us, *columns))
        if truth is not None:
            shifted = PixelTruth(truth.t_us - zero_us, truth.u_px, truth.v_px, truth.r_px, truth.visible)
            self._writer.write_truth(batch.camera, shifted)

    def _write_state(self, state: m.WorldState, zero_us: int) -> None:
        ball = state.truth()
        if ball is not None:
            self._writer.write_ball(
                BallTruth(ball.t_us - zero_us, ball.p_world_m, ball.v_world_mps, ball.spin_radps, ball.visible)
            )
        if len(state.racket_t_us):
            self._writer.append_rows(RACKET, racket_rows(state, zero_us))
        if state.scene and state.scene != self._scene and self._seed is not None:
            self._scene = state.scene
            since_us = state.start_us - zero_us
            self._writer.append_rows(SCENES_SEEN, scene_rows(since_us, state.scene, self._seed, zero_us))
        self._writer.extend_duration(state.t_us - zero_us)
        self._blocks += 1
        if self._blocks % FLUSH_BLOCKS == 0:
            self._writer.flush()
