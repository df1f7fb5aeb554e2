"""The app's process: a viser server, one session per browser, and the one loop that changes anything."""

from __future__ import annotations

import contextlib
import io
import logging
import socket
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import viser

from app.library import Library
from app.session import Session
from app.theme import apply_theme
from app.watch.live import LIVE, LiveRally
from app.watch.rallies import Rallies
from app.workspace import Workspace
from core.detection import DetectorConfig, FastDetector, TrackState, trace_window
from core.detection.fast_cluster import grid_labels
from core.errors import CommandError
from core.events import Events, SensorSize, Window

logger = logging.getLogger(__name__)
TICK_S = 1 / 60
IDLE_S = 0.25
RESCAN_EVERY_S = 2.0
POOL_THREADS = 3


class Lab:
    """The running app. `port` 0 takes any free one."""

    def __init__(
        self,
        workspace: Workspace,
        library: Library,
        first_recording: str,
        *,
        host: str,
        port: int,
        config: DetectorConfig | None = None,
        autoplay: bool = False,
        live: LiveRally | None = None,
    ) -> None:
        """`config` is what every browser's detector starts with; `live` is closed with the app."""
        self._workspace = workspace
        self._library = library
        self._first_recording = first_recording
        self._config = config or DetectorConfig()
        self._autoplay = autoplay
        self._rallies = Rallies(live)
        if live is not None:
            library.add_live(LIVE, live.recording)
        self._sessions: dict[int, Session] = {}
        self._lock = threading.Lock()
        self._awake = threading.Event()
        self._stopping = False
        # A browser may close while a picture is on its way to it; that is no news.
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
        self._pool = ThreadPoolExecutor(POOL_THREADS, thread_name_prefix="rallyscope")
        self._server = _start_server(host, port)
        apply_theme(self._server)
        self._server.on_client_connect(self._connect)
        self._server.on_client_disconnect(self._disconnect)
        self._loop = threading.Thread(target=self._run, name="rallyscope-loop", daemon=True)
        self._loop.start()
        self._pool.submit(_warm_up)

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.get_port()

    @property
    def workspace(self) -> Workspace:
        """Its folder."""
        return self._workspace

    @property
    def rallies(self) -> Rallies:
        """What its browsers watch."""
        return self._rallies

    @property
    def viser_server(self) -> viser.ViserServer:
        """The server underneath."""
        return self._server

    @property
    def sessions(self) -> tuple[Session, ...]:
        """The browsers that are connected now."""
        with self._lock:
            return tuple(self._sessions.values())

    def stop(self) -> None:
        """End everything."""
        self._stopping = True
        self._awake.set()
        self._loop.join(timeout=5)
        for session in list(self._sessions.values()):
            session.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._rallies.close()
        self._library.close()

    def _connect(self, client: viser.ClientHandle) -> None:
        session = Session(
            client, self._library, self._workspace, self._pool, self._rallies, self._awake.set, self._config
        )
        session.offer(self._library.names(), self._workspace.config_names())
        session.open_recording(self._first_recording)
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
        rescanned_s = 0.0
        while not self._stopping:
            started_s = time.monotonic()
            sessions = self.sessions
            if started_s - rescanned_s > RESCAN_EVERY_S:
                rescanned_s = started_s
                self._rescan(sessions)
            for session in sessions:
                try:
                    session.tick(started_s)
                except Exception:
                    logger.exception("a browser's update failed")
            restless = any(session.restless for session in sessions)
            spent_s = time.monotonic() - started_s
            if restless:
                time.sleep(max(0.0, TICK_S - spent_s))
            else:
                self._awake.wait(IDLE_S)
            self._awake.clear()

    def _rescan(self, sessions: tuple[Session, ...]) -> None:
        try:
            recordings, configs = self._library.names(), self._workspace.config_names()
        except (OSError, CommandError):
            logger.exception("cannot list the workspace")
            return
        for session in sessions:
            session.offer(recordings, configs)


def _start_server(host: str, port: int) -> viser.ViserServer:
    """A viser server at exactly this port; viser itself would silently take the next one.

    Raises:
        CommandError: if the address cannot be used.
    """
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        raise CommandError(
            f"cannot listen on {host}:{port}", got=str(error), remedy="choose another with --port or --host"
        ) from error
    with contextlib.redirect_stdout(io.StringIO()):  # its banner would repeat what `rallyscope serve` says
        return viser.ViserServer(host=host, port=port, verbose=False)


def _warm_up() -> None:
    """Load the compiled code that the first picture needs while the browser is still loading its page."""
    window = Window(Events.empty(SensorSize(64, 64)), 0, 1000)
    trace_window(window, TrackState(), DetectorConfig(), label_clusters=grid_labels)
    FastDetector(DetectorConfig()).step(window)
