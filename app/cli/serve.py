"""`rallyscope serve`: open the app on a recording, by default on the demo."""

from __future__ import annotations

import argparse
import logging
import signal
import threading
import webbrowser
from pathlib import Path

from app.cli.progress import progress_bar
from app.library import Library
from app.workspace import Workspace
from core.config import load_config
from core.detection import DetectorConfig
from core.errors import NotBuiltError

DEMO = "demo"
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("recording", nargs="?", type=Path, metavar="RECORDING", help="a recording or an event file")
    parser.add_argument("--source", metavar="live|tcp://HOST:PORT", help="watch a simulation (not built yet)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: %(default)s, this machine)")
    parser.add_argument("--port", type=int, default=8080, help="port to listen on (default: %(default)s)")
    parser.add_argument("--data", type=Path, default=Path("rallyscope-data"), help="workspace (default: %(default)s)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="detector settings to start with, a TOML file")
    parser.add_argument("--open", action="store_true", help="open a browser")


def run(arguments: argparse.Namespace) -> None:
    """Serve until interrupted."""
    if arguments.source is not None:
        raise NotBuiltError("`--source` is not built yet", remedy="open a recording")
    config = load_config(DetectorConfig, arguments.config) if arguments.config else DetectorConfig()
    workspace = Workspace(arguments.data)
    library = Library(workspace)
    first = _first_recording(arguments.recording, workspace, library)
    from app.server import Lab  # after the recording: a mistake in the arguments is answered at once

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # broken connections of browsers are not our news
    lab = Lab(
        workspace,
        library,
        first,
        host=arguments.host,
        port=arguments.port,
        config=config,
        autoplay=first == DEMO,
    )
    url = f"http://{'127.0.0.1' if arguments.host == '0.0.0.0' else arguments.host}:{lab.port}"
    if arguments.host not in LOCAL_HOSTS:
        print(f"Anyone who can reach {arguments.host} can use this app: it has no passwords.", flush=True)
    print(f"Rallyscope shows {first!r} at {url}   (Ctrl-C ends it)", flush=True)
    if arguments.open:
        webbrowser.open(url)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    ended.wait()
    lab.stop()


def _first_recording(path: Path | None, workspace: Workspace, library: Library) -> str:
    """Name of the recording to begin with; made or imported first if need be."""
    if path is None:
        from core.simulation import ensure_demo

        with progress_bar("Simulating the demo recording (only the first time)") as progress:
            ensure_demo(workspace.recording_path(DEMO), progress)
        return DEMO
    name = library.add_guest(path)
    with progress_bar(f"Opening {path.name}") as progress:
        library.open(name)
        progress(1.0)
    return name
