"""`rallyscope sim-server`: the live simulation as its own process."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from app.cli.arguments import flag, setting_flag
from app.cli.cameras import Sensor, named_cameras
from app.cli.constants import CONSTANTS_HELP, given_constants
from app.cli.ending import end_event
from app.cli.simulate import SceneArguments
from app.cli.terminal import say
from core.cameras.presets import SENSOR_720
from core.errors import CommandError
from core.files import end_with_parent
from core.live.link.guard import check_reach, make_keys, read_server_keys, split_address
from core.live.link.server import KernelProgress, ServerConfig, SimulationServer
from core.live.urgency import freeze_loaded
from core.live.worlds.world import WorldConfig
from core.physics.ball_states import join_serves, read_ball_states
from core.physics.config import Profile
from core.physics.task import task_profile
from core.simulation import SensorConfig, StereoConfig
from core.simulation.episodes.incoming import RecordedServes

QUIET_S = 2.0
SAY_EVERY = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class SimServerArguments:
    """Run the live simulation as its own process."""

    bind: str = flag(
        "publish on this port and take commands on the next; port 0 picks free ones",
        "tcp://HOST:PORT",
        "tcp://127.0.0.1:5555",
    )
    keys: Path | None = flag(
        "folder with the server's keys and its clients' public keys; required for other machines", "DIR"
    )
    make_keys: Path | None = flag(
        "create keys for a server and a client in this folder, or for one more client, and exit", "DIR"
    )
    cameras: str = flag("camera placement, or a calibration file", "PRESET|FILE", "side")
    sensor: Sensor | None = flag("sensor size of a placement's cameras", "WxH", SENSOR_720)
    scene: SceneArguments
    noise_hz: float = setting_flag(SensorConfig, "noise_hz", "HZ")
    physics: Profile | None = flag("flight of the ball", default="paper; real with --ball-states")
    constants: Path | None = flag(CONSTANTS_HELP, "FILE")
    ball_states: tuple[Path, ...] | None = flag("serve these recorded balls (JSON) instead of random ones", "FILE")
    auto_serve: float = setting_flag(ServerConfig, "auto_serve_mps", "MPS")
    until_eof: bool = flag("exit when standard input ends (for use as a child process)")
    seed: int = flag("random seed of serves and events", "N", 0)


def run(arguments: SimServerArguments) -> None:
    """Serve until interrupted."""
    if arguments.make_keys is not None:
        _make_keys(arguments.make_keys)
        return
    keys = None if arguments.keys is None else read_server_keys(arguments.keys)
    check_reach(split_address(arguments.bind)[0], keys)  # at once: the rest takes a while
    if arguments.seed < 0:
        raise CommandError("no such seed", expected="a whole number from 0", got=arguments.seed, where="--seed")
    if arguments.auto_serve and not 3 <= arguments.auto_serve <= 9:
        raise CommandError("no such serve", expected="3 to 9 m/s", got=arguments.auto_serve, where="--auto-serve")
    constants = given_constants(arguments.constants, arguments.physics)
    task = task_profile(arguments.physics or ("real" if arguments.ball_states else "paper"), constants)
    recorded = None
    if arguments.ball_states:
        recorded = RecordedServes(join_serves([read_ball_states(path) for path in arguments.ball_states]), task)
    world = WorldConfig(
        task=task,
        stereo=StereoConfig(scene=arguments.scene.config(), sensor=SensorConfig(noise_hz=arguments.noise_hz)),
    )
    config = ServerConfig(world=world, auto_serve_mps=arguments.auto_serve)
    cameras = named_cameras(arguments.cameras, arguments.sensor)
    if arguments.until_eof:
        end_with_parent()
    server = SimulationServer(
        config,
        cameras,
        arguments.bind,
        seed=arguments.seed,
        recorded=recorded,
        preparing=_tell_progress(),
        keys=keys,
    )
    server.prepare()
    freeze_loaded()
    ended = end_event()
    say(f"The simulation is at {server.address}   (Ctrl-C ends it)")
    server.run(ended.is_set)


def _make_keys(folder: Path) -> None:
    server, client = make_keys(folder)
    say(f"{server}: the server's keys, for `rallyscope sim-server --bind tcp://HOST:PORT --keys {server}`")
    say(
        f"{client}: a client's keys. Copy them to its machine over a safe channel, then run there: "
        f"`rallyscope serve --source tcp://HOST:PORT --keys {client.name}`"
    )


def _tell_progress() -> KernelProgress:
    """Says on standard error how far the compiler is, if that takes a while: the first time only."""
    began_s, reported = time.monotonic(), 0

    def tell(ready: int, known: int) -> None:
        nonlocal reported
        if time.monotonic() - began_s > QUIET_S and ready >= reported + SAY_EVERY:
            reported = ready
            say(f"compiling, on the first start only: {ready} of about {known} kernels", error=True)

    return tell
