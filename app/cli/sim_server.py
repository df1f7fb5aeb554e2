"""`rallyscope sim-server`: the live simulation as its own process."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import time
from pathlib import Path

from app.cli.cameras import named_cameras, sensor_size
from app.cli.scenes import add_scene_arguments, scene_of
from core.errors import CommandError
from core.files import end_with_parent
from core.physics.ball_states import join_serves, read_ball_states
from core.physics.task import task_profile
from core.rally.link.responder import KernelProgress
from core.rally.link.server import ServerConfig, SimulationServer
from core.rally.simulated.world import WorldConfig
from core.simulation import SensorConfig, StereoConfig
from core.simulation.episodes.recorded_serves import RecordedServes

QUIET_S = 2.0
SAY_EVERY = 5
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "--bind",
        default="tcp://127.0.0.1:5555",
        metavar="tcp://HOST:PORT",
        help="publish here and take commands on the next port (default: %(default)s; port 0 takes free ones)",
    )
    parser.add_argument("--cameras", default="side", metavar="PRESET|FILE", help="placement, or a calibration file")
    parser.add_argument(
        "--sensor", type=sensor_size, metavar="WxH", help="of a placement's cameras (default: 1280x720)"
    )
    add_scene_arguments(parser)
    parser.add_argument("--noise-hz", type=float, default=0.1, metavar="HZ", help="background events (default: 0.1)")
    parser.add_argument(
        "--physics", choices=("paper", "real"), help="flight of the ball (default: paper; real with --ball-states)"
    )
    parser.add_argument(
        "--ball-states", nargs="+", type=Path, metavar="FILE", help="serve recorded balls (JSON), not drawn ones"
    )
    parser.add_argument("--auto-serve", type=float, default=0.0, metavar="MPS", help="serve by itself at 3 to 9 m/s")
    parser.add_argument(
        "--until-eof", action="store_true", help="end when standard input ends, as a child process should"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of serves and events (default: 0)")


def run(arguments: argparse.Namespace) -> None:
    """Serve until interrupted."""
    if arguments.seed < 0:
        raise CommandError("no such seed", expected="a whole number from 0", got=arguments.seed, where="--seed")
    if arguments.auto_serve and not 3 <= arguments.auto_serve <= 9:
        raise CommandError("no such serve", expected="3 to 9 m/s", got=arguments.auto_serve, where="--auto-serve")
    task = task_profile(arguments.physics or ("real" if arguments.ball_states else "paper"))
    recorded = None
    if arguments.ball_states:
        recorded = RecordedServes(join_serves([read_ball_states(path) for path in arguments.ball_states]), task)
    world = WorldConfig(
        task=task,
        stereo=StereoConfig(scene=scene_of(arguments), sensor=SensorConfig(noise_hz=arguments.noise_hz)),
    )
    config = ServerConfig(world=world, auto_serve_mps=arguments.auto_serve)
    cameras = named_cameras(arguments.cameras, arguments.sensor)
    if arguments.until_eof:
        end_with_parent()
    server = SimulationServer(
        config, cameras, arguments.bind, seed=arguments.seed, recorded=recorded, preparing=_tell_progress()
    )
    server.prepare()
    host = server.address.removeprefix("tcp://").rpartition(":")[0]
    if host not in LOOPBACK:
        print(f"Anyone who can reach {host} can command this simulation: it has no passwords.", flush=True)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    print(f"The simulation is at {server.address}   (Ctrl-C ends it)", flush=True)
    server.run(ended.is_set)


def _tell_progress() -> KernelProgress:
    """Says on standard error how far the compiler is, if that takes a while: the first time only."""
    began_s, said = time.monotonic(), 0

    def tell(ready: int, known: int) -> None:
        nonlocal said
        if time.monotonic() - began_s > QUIET_S and ready >= said + SAY_EVERY:
            said = ready
            print(f"compiling, on the first start only: {ready} of about {known} kernels", file=sys.stderr, flush=True)

    return tell
