"""The app's process: a viser server, one session per browser, and the one loop that changes anything."""

from __future__ import annotations

import contextlib
import functools
import gc
import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import viser

from app.modes.services import Services
from app.panels.recording_info import gather_info
from app.scene.painted import floor_picture
from app.session import Session
from app.shared.files import incoming_folder
from app.shared.job_backends import HERE_ONLY, JobBackends
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from app.startup.startup import Preparation
from app.web import Admission, Gateway, open_gateway
from core.chain.config import ChainConfig, HitRule, PredictionName, chain_with_constants
from core.detection import DetectorConfig, FastDetector, TrackState, trace_window
from core.detection.fast.cluster import grid_labels
from core.detection.methods import DEFAULT_METHOD, make_detector
from core.detection.saved import SavedDetector
from core.errors import CommandError, RallyscopeError
from core.events import Events, SensorSize, Window
from core.files import clear_unfinished
from core.physics.constants_file import FittedConstants

logger = logging.getLogger(__name__)


AFTER_S: Final = (5.0, 30.0, 120.0)
"""Times after the first browser connected; by then scene, chain and the modules of Watch are loaded."""


class GcFreeze:
    """Freezes existing objects a few times after the app's start; garbage at that moment is never freed."""

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._done = 0

    def tick(self, wall_s: float, *, busy: bool) -> None:
        """`busy`: a browser is connected."""
        if self._begun_s is None and busy:
            self._begun_s = wall_s
        if self._begun_s is None or self._done == len(AFTER_S) or wall_s - self._begun_s < AFTER_S[self._done]:
            return
        self._done += 1
        gc.freeze()


TICK_S = 1 / 61
"""Period of the loop, s: 60 Hz; late turns may be skipped."""
IDLE_S = 0.25
RESCAN_EVERY_S = 2.0
POOL_THREADS = 3


class App:
    """The running app. `port` 0 takes any free one."""

    def __init__(
        self,
        workspace: Workspace,
        library: Library,
        first_recording: str,
        *,
        host: str,
        port: int,
        detector: SavedDetector | None = None,
        autoplay: bool = False,
        live: LiveRally | None = None,
        preparation: Preparation | None = None,
        admission: Admission | None = None,
        front: Gateway | None = None,
        viewer_address: str | None = None,
        places: JobBackends = HERE_ONLY,
        prediction: PredictionName = "filter",
        hit: HitRule | None = None,
        constants: FittedConstants | None = None,
    ) -> None:
        """`detector` is what every browser starts with, unless that is as it was left; `live` is closed with the app.

        `viewer_address` is that of a Rerun viewer which may be streamed to, `rerun+http://HOST:PORT/proxy`. Trainings
        and searches may be done at `places`. Hits are predicted with `prediction`, unless a browser chooses another;
        its filter begins with fitted `constants` of air and table where they are given. `hit`: where a live rally meets
        the ball, by default as `LivePlayerConfig` has it.

        A first recording that is not there yet, such as a live rally that is being prepared, is opened when it comes.
        A `front` that listens there already may be given; browsers that came to it meanwhile are served, too.
        """
        self.services = Services.of(workspace, library, viewer_address, places)
        """Services shared by all browsers."""
        self.services.rallies.prediction = prediction
        self._constants = constants
        self._hit: HitRule | None = hit
        if constants is not None:
            self.services.rallies.followings.chain = chain_with_constants(ChainConfig(), constants)
        self._first_recording = first_recording
        self._detector = detector
        self._autoplay = autoplay
        self._preparation = preparation
        self._sessions: dict[int, Session] = {}
        self._lock = threading.Lock()
        self._awake = threading.Event()
        self._stopping = False
        self._loaded = GcFreeze()
        if live is not None:
            self.use_live(live)
        self._pool = ThreadPoolExecutor(POOL_THREADS, thread_name_prefix="rallyscope")
        self._front = front or open_gateway(host, port, admission)
        self._front.pages.uploads.new_folder = functools.partial(incoming_folder, workspace)
        self._server = self._front.server
        self._server.on_client_connect(self._connect)
        self._server.on_client_disconnect(self._disconnect)
        self._loop = threading.Thread(target=self._run, name="rallyscope-loop", daemon=True)
        self._loop.start()
        # After the loop has begun: whoever connects meanwhile sees how far it is.
        self._pool.submit(self._prepare)
        self._pool.submit(clear_unfinished, workspace.recordings)

    @property
    def port(self) -> int:
        """Port of the server."""
        return self._server.get_port()

    @property
    def viser_server(self) -> viser.ViserServer:
        """The viser server."""
        return self._server

    @property
    def sessions(self) -> tuple[Session, ...]:
        """Sessions of the connected browsers."""
        with self._lock:
            return tuple(self._sessions.values())

    def use_live(self, live: LiveRally) -> None:
        """Offer a live rally from now on; it is closed with the app. From any thread."""
        live.predict_with(self.services.rallies.prediction)
        if self._hit is not None:
            live.hit_at(self._hit)
        if self._constants is not None:
            live.begin_with(self._constants)
        self.services.rallies.live = live
        self.services.library.add_live(LIVE, live.recording)
        self._awake.set()

    def stop(self) -> None:
        """End everything."""
        self._stopping = True
        self._awake.set()
        self._loop.join(timeout=5)
        with self._lock:  # one that disconnects meanwhile is closed once
            sessions, self._sessions = tuple(self._sessions.values()), {}
        for session in sessions:
            session.close()
        self._server.stop()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self.services.close()

    def _prepare(self) -> None:
        """Prepare the first picture while the browser is loading its page."""
        floor_picture()
        library, name = self.services.library, self._first_recording
        if name != LIVE and library.has(name):
            with contextlib.suppress(RallyscopeError):  # shown when it is opened
                gather_info(library, name)
        _warm_up()

    def _connect(self, client: viser.ClientHandle) -> None:
        visit = self._front.visit(client)
        session = Session(
            client,
            self.services,
            self._pool,
            self._awake.set,
            self._detector,
            self._preparation,
            visit=visit,
            pages=self._front.pages,
        )
        offered = self.services.library.names()
        session.offer(offered)
        session.await_recording(session.page.first_recording(self._first_recording, offered))
        if self._autoplay:
            session.play_when_open()
        with self._lock:
            self._sessions[client.client_id] = session

    def _disconnect(self, client: viser.ClientHandle) -> None:
        with self._lock:
            session = self._sessions.pop(client.client_id, None)
        if session is not None:
            session.close()

    def _run(self) -> None:
        rescanned_s = due_s = 0.0
        while not self._stopping:
            started_s = time.monotonic()
            due_s = max(due_s, started_s - TICK_S) + TICK_S  # catch up one late tick, not more
            sessions = self.sessions
            self.services.rallies.set_active(any(session.watches_live for session in sessions), started_s)
            self._loaded.tick(started_s, busy=bool(sessions))
            if sessions and started_s - rescanned_s > RESCAN_EVERY_S:
                rescanned_s = started_s
                self._rescan(sessions)
            for session in sessions:
                try:
                    session.tick(started_s)
                    session.client.flush()  # viser waits 1/60 s after each send by default
                except Exception:
                    logger.exception("a browser's update failed")
            needs_tick = any(session.needs_tick for session in sessions)
            if needs_tick:
                time.sleep(max(0.0, due_s - time.monotonic()))
            else:
                self._awake.wait(IDLE_S)
            self._awake.clear()

    def _rescan(self, sessions: tuple[Session, ...]) -> None:
        try:
            recordings = self.services.library.names()
        except (OSError, CommandError):
            logger.exception("cannot list the workspace")
            return
        for session in sessions:
            session.offer(recordings)


def _warm_up() -> None:
    """Load the compiled code of the default detectors."""
    window = Window(Events.empty(SensorSize(64, 64)), 0, 1000)
    trace_window(window, TrackState(), DetectorConfig(), label_clusters=grid_labels)
    FastDetector(DetectorConfig()).step(window)
    make_detector(DEFAULT_METHOD, window.events.sensor).step(window)
