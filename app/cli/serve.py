"""`rallyscope serve`: open the app on a recording, by default on the demo."""

from __future__ import annotations

import gc
import logging
import socket
import webbrowser
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.arguments import DATA, flag, positional
from app.cli.constants import CONSTANTS_OF_BALL, given_constants
from app.cli.ending import end_event
from app.cli.event_cameras import CAMERA, CameraArguments, CameraOrder, open_camera_source, read_camera_order
from app.cli.progress import progress_bar
from app.cli.replay import REPLAY, ReplayOrder, open_replay, read_replay
from app.cli.terminal import say, silence_viser
from app.export.viewer_streamer import check_viewer_address
from app.shared.job_backends import JobBackends
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.web import Admission, Gateway, open_gateway
from app.web.access_policy import check_address
from core.chain.config import HIT_RULES, PREDICTIONS, HitRule, PredictionName
from core.detection.saved import load_detector
from core.errors import CommandError
from core.live.link.guard import ClientKeys, check_reach, read_client_keys, split_address
from core.live.urgency import shorten_turns
from core.physics.config import PhysicsConfig, Profile, physics_profile
from core.registry import discover_plugins

if TYPE_CHECKING:
    from app.server import App
    from app.startup.startup import Startup

LIVE = "live"


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeArguments:
    """Open the app in a browser, on a recording or a live source: a simulation, event cameras, or a recording replayed
    as if live.
    """

    recording: Path | None = positional("recording or event file to open", "RECORDING")
    source: str | None = flag(
        "live source: a simulation started for this app (live), one that runs elsewhere (tcp:), a recording that is "
        "replayed in a loop as if live, SPEED times as fast (replay:), or event cameras (camera:)",
        "live|tcp://HOST:PORT|replay:FILE[@SPEED]|camera:SERIAL[,SERIAL...]",
        "live, without a recording",
    )
    cameras: CameraArguments
    keys: Path | None = flag("folder with the client's keys, for a source on another machine", "DIR")
    robot: str | None = flag("your robot; it plays the balls that cameras or a replay see", "tcp://HOST:PORT")
    robot_keys: Path | None = flag("folder with the client's keys, for a robot on another machine", "DIR")
    physics: Profile | None = flag(
        "physics of the live simulation; with --robot, of the rubber that the built-in controller assumes",
        default="paper",
    )
    constants: Path | None = flag(f"{CONSTANTS_OF_BALL}: of the live simulation's ball, and of every filter", "FILE")
    ball_states: tuple[Path, ...] | None = flag(
        "the live simulation serves these recorded balls (JSON); its physics is then `real`", "FILE"
    )
    host: str = flag("address to listen on; the default is this machine only", default="127.0.0.1")
    port: int = flag("port to listen on", default=8080)
    token: str | None = flag(
        "token that browsers need to connect",
        "TOKEN",
        "random if other machines can connect, or with a robot or cameras; else none",
    )
    data: Path = flag("workspace folder: recordings, labels, runs, exports", default=DATA)
    folder: tuple[Path, ...] | None = flag(
        "offer the files of this folder, too; repeat it for more folders", "DIR", repeated=True
    )
    config: Path | None = flag("detector settings to start with, a TOML file", "FILE")
    prediction: PredictionName = flag(
        "how hits are predicted: filter, every point; paper, its five points before and after the bounce",
        "|".join(PREDICTIONS),
        "filter",
        choices=PREDICTIONS,
    )
    hit: HitRule | None = flag(
        "where the live rally meets the ball: chosen, along its flight within the racket's reach; paper, at the plane "
        "5 cm behind the table",
        "|".join(HIT_RULES),
        "chosen; paper before a robot that states no limits",
        choices=HIT_RULES,
    )
    rerun: str | None = flag("a Rerun viewer that Export may stream to", "rerun+http://HOST:PORT/proxy")
    cluster: str | None = flag("a Dask cluster that Train and Tune may use", "tcp://HOST:PORT")
    open: bool = flag("open a browser")


def run(arguments: ServeArguments) -> None:
    """Serve until interrupted."""
    shorten_turns()
    discover_plugins()  # what is wrong with one is said here, and not to a browser
    source = _check_source(arguments.source, arguments.recording)
    constants = given_constants(arguments.constants, arguments.physics)
    replay = read_replay(source) if source is not None else None
    order = read_camera_order(source, arguments.cameras)
    keys = read_keys(arguments.keys, source)
    own = own_simulation(arguments, source)
    robot_keys = read_robot_keys(arguments.robot, arguments.robot_keys, source)
    if arguments.rerun is not None:
        check_viewer_address(arguments.rerun)
    places = JobBackends(arguments.cluster)
    detector = load_detector(arguments.config) if arguments.config else None
    workspace = Workspace(arguments.data)
    library = Library(workspace, _check_folders(arguments.folder or ()))
    library.names()  # where no folder can be made that is said before anything is started
    machines = arguments.robot is not None or (source or "").startswith(CAMERA)
    admission = Admission.of_address(arguments.host, arguments.token, moves_machines=machines)
    check_address(arguments.host, arguments.port)
    with ExitStack() as started:

        def start() -> Startup:
            robot = None if arguments.robot is None else (arguments.robot, robot_keys)
            physics = rally_physics(arguments, source)
            startup = _start(workspace, source or LIVE, order or replay, own, keys, robot, physics)
            started.callback(startup.stop)
            return startup

        startup = None
        if source not in (None, LIVE):  # it may not be there, which is said before there is a page
            startup = start()
            if startup.remote:
                startup.wait_for_change()
                if startup.problem is not None:
                    raise startup.problem
        first = LIVE if arguments.recording is None else _open_recording(arguments.recording, library)
        ended = end_event()
        front = _open_page(arguments, admission, first)
        if source == LIVE:
            startup = start()
        lab = _app_class()(
            workspace,
            library,
            first,
            host=arguments.host,
            port=arguments.port,
            detector=detector,
            preparation=None if startup is None else startup.preparation,
            front=front,
            viewer_address=arguments.rerun,
            places=places,
            prediction=arguments.prediction,
            hit=arguments.hit,
            constants=constants,
        )
        if startup is not None:
            startup.hand_over(lab.use_live)
        ended.wait()
        started.close()  # first: what it prepares goes to the app
        lab.stop()


def _app_class() -> type[App]:
    """Loaded late, while a browser loads the page: a second's work."""
    gc.disable()  # what is loaded stays: looking through it again and again takes a tenth of the time
    from app.server import App

    gc.freeze()
    gc.enable()
    return App


def _open_page(arguments: ServeArguments, admission: Admission, first: str) -> Gateway:
    """What browsers may come to from now on, while the app behind it is still being loaded."""
    silence_viser()
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # broken connections of browsers are not our news
    front = open_gateway(arguments.host, arguments.port, admission)
    port = front.server.get_port()
    url = page_url(arguments.host, port, admission)
    if not admission.local:
        say(tunnel_advice(port))
    say(f"Rallyscope shows {first!r} at {url}   (Ctrl-C ends it)")
    if arguments.open:
        webbrowser.open(url)
    return front


def _start(
    workspace: Workspace,
    source: str,
    source_order: CameraOrder | ReplayOrder | None,
    own: list[str],
    keys: ClientKeys | None,
    robot: tuple[str, ClientKeys | None] | None,
    physics: PhysicsConfig | None,
) -> Startup:
    """What brings up the live rally while the app is loaded; `robot`: its address and the keys for it; `physics`: what
    cameras or a replay are given.
    """
    from app.startup.startup import Startup  # takes a while: a mistake in the arguments is answered before
    from core.robot import RobotClient

    if source_order is not None:
        if isinstance(source_order, CameraOrder):
            opened = open_camera_source(source_order, physics=physics)
        else:
            opened = open_replay(source_order, physics=physics)
        player = None if robot is None else RobotClient(robot[0], keys=robot[1])
        return Startup(workspace, source=opened, say=say, robot=player)
    player = None if robot is None else RobotClient(robot[0], keys=robot[1])
    address = None if source == LIVE else source
    return Startup(workspace, address=address, arguments=("--auto-serve", "5", *own), say=say, keys=keys, robot=player)


def page_url(host: str, port: int, admission: Admission) -> str:
    """What to open in a browser; with the token where one is needed."""
    everywhere = host in ("0.0.0.0", "::", "")
    name = socket.gethostname() if everywhere else f"[{host}]" if ":" in host else host
    token = "" if admission.token is None else f"/?token={admission.token}"
    return f"http://{name}:{port}{token}"


def tunnel_advice(port: int) -> str:
    """What is safer than listening beyond this machine."""
    return (
        "Other machines can connect; whoever has the link can use this app, and nothing on the way is encrypted.\n"
        f"Safer: without --host here, and on the other machine: ssh -L {port}:localhost:{port} {socket.gethostname()}, "
        f"then http://localhost:{port} there."
    )


def _check_source(source: str | None, recording: Path | None) -> str | None:
    """The source of the live rally; None for a recording.

    Raises:
        CommandError: if both are given, or it is not a source.
    """
    if source is None:
        return LIVE if recording is None else None
    if recording is not None:
        raise CommandError("a recording and a source", expected="one of them", got=f"{recording} and {source}")
    if source != LIVE and not source.startswith(("tcp://", REPLAY, CAMERA)):
        expected = "live, tcp://HOST:PORT, replay:FILE[@SPEED] or camera:SERIAL[,SERIAL...]"
        raise CommandError("not a source", expected=expected, got=repr(source), where="--source")
    return source


def read_keys(folder: Path | None, source: str | None) -> ClientKeys | None:
    """The keys for a source; None where none are given.

    Raises:
        CommandError: if there is no simulation that could ask for them.
        LinkError: if they cannot be used, or the source is beyond this machine and there are none.
    """
    if source is None or not source.startswith("tcp://"):
        if folder is not None:
            raise CommandError("keys without a source", expected="--source tcp://HOST:PORT", where="--keys")
        return None
    keys = None if folder is None else read_client_keys(folder)
    check_reach(split_address(source, lowest=1)[0], keys)
    return keys


def read_robot_keys(address: str | None, folder: Path | None, source: str | None) -> ClientKeys | None:
    """The keys for a robot; None where none are given.

    Raises:
        CommandError: if there are keys without a robot, or a robot without a source that it could play to.
        LinkError: if the address is none, the keys cannot be used, or it is beyond this machine and there are none.
    """
    if address is None:
        if folder is not None:
            raise CommandError("keys without a robot", expected="--robot tcp://HOST:PORT", where="--robot-keys")
        return None
    if source is None or source == LIVE:
        expected = "--source camera:..., replay:... or tcp://... without a robot"
        got = "a recording" if source is None else "a simulation with a robot of its own"
        raise CommandError("nothing that this robot could play to", expected=expected, got=got, where="--robot")
    keys = None if folder is None else read_client_keys(folder)
    check_reach(split_address(address, lowest=1)[0], keys, "--robot-keys")
    return keys


def _check_folders(folders: tuple[Path, ...]) -> tuple[Path, ...]:
    """The folders whose files are offered.

    Raises:
        CommandError: if one is none.
    """
    for folder in folders:
        if not folder.is_dir():
            raise CommandError("not a folder", got=str(folder), where="--folder")
    return tuple(dict.fromkeys(folder.resolve() for folder in folders))


def rally_physics(arguments: ServeArguments, source: str | None) -> PhysicsConfig | None:
    """Physics given for what cameras or a replay show to a robot; None if it is not given, or for another source."""
    if arguments.physics is None or arguments.robot is None or not (source or "").startswith((REPLAY, CAMERA)):
        return None
    return physics_profile(arguments.physics)


def own_simulation(arguments: ServeArguments, source: str | None) -> list[str]:
    """What the simulation that is started for the app is told; files are read here, where a mistake can be answered.

    Raises:
        CommandError: if something is asked of it, but there is none.
        RecordingError: if a file holds no ball states.
    """
    physics = None if rally_physics(arguments, source) is not None else arguments.physics
    extra: list[str] = [] if physics is None else ["--physics", physics]
    if arguments.constants is not None and source == LIVE:
        extra += ["--constants", str(arguments.constants)]
    if arguments.ball_states is not None:
        from core.physics.ball_states import read_ball_states

        for path in arguments.ball_states:
            read_ball_states(path)
        extra += ["--ball-states", *map(str, arguments.ball_states)]
    if extra and source != LIVE:
        expected = "--source live, or --robot for --physics with cameras or a replay"
        raise CommandError("not a simulation of its own", expected=expected, got=source or arguments.recording)
    return extra


def _open_recording(path: Path, library: Library) -> str:
    """Name of the recording to begin with; imported first if need be."""
    name = library.add_external(path)
    with progress_bar(f"Opening {path.name}") as progress:
        library.open(name)
        progress(1.0)
    return name
