"""The start beside the app: what fails is said, what is started ends."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.shared.workspace import Workspace
from app.startup.startup import REPLAY_STEPS, Startup
from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import SensorSize
from core.live.link.server import ServerConfig, SimulationServer
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import RobotClient
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually


def states(startup: Startup) -> list[str]:
    return [step.state for step in startup.preparation.steps]


def test_a_simulation_that_does_not_start_is_said_in_words(tmp_path) -> None:
    said: list[str] = []
    startup = Startup(Workspace(tmp_path), arguments=("--physics", "moon"), say=said.append)
    eventually(lambda: states(startup)[0] == "failed", "the start to fail", lambda: states(startup))
    assert isinstance(startup.problem, LinkError)
    assert any("invalid choice" in line for line in said)
    startup.stop()


def test_nobody_at_the_address_is_known_at_once(tmp_path) -> None:
    startup = Startup(Workspace(tmp_path), address="tcp://127.0.0.1:1")
    startup.wait_for_change()
    assert "no answer from a simulation server" in str(startup.problem)
    startup.stop()


def test_a_step_that_fails_is_reported_with_the_last_words_of_its_own_child(tmp_path) -> None:
    startup = Startup(Workspace(tmp_path), address="tcp://127.0.0.1:1")
    with ThreadPoolExecutor(2) as pool:
        run = lambda name: startup._run_child("chain", "app.cli", "info", f"{name}.h5")  # noqa: E731
        one, other = pool.map(run, ("one", "other"))  # beside each other, as the demo and the detector
    assert "one.h5" in one and "other.h5" in other
    startup.stop()


def test_once_stopped_nothing_more_is_said(tmp_path, monkeypatch) -> None:
    under_way, go_on = threading.Event(), threading.Event()

    def compile_slowly(on_progress) -> None:
        on_progress(1, 4)
        under_way.set()
        assert go_on.wait(PATIENCE_S)
        on_progress(4, 4)

    monkeypatch.setattr("app.startup.startup.marker", lambda: None)
    monkeypatch.setattr("app.startup.startup.compile_chain", compile_slowly)
    said: list[str] = []
    startup = Startup(Workspace(tmp_path), address="tcp://127.0.0.1:1", say=said.append)
    assert under_way.wait(PATIENCE_S)
    startup.wait_for_change()
    startup.stop()
    before = list(said)
    go_on.set()
    eventually(lambda: states(startup)[1] == "done", "the detector to be compiled", lambda: states(startup))
    assert any("Compiling the ball detector" in line for line in before) and said == before


@pytest.mark.parametrize("before", [True, False])
def test_the_rally_of_a_server_is_handed_over_once(tmp_path, before) -> None:
    server = SimulationServer(ServerConfig(), stereo_preset("side", SensorSize(64, 48)), "tcp://127.0.0.1:0")
    taken = []
    startup = Startup(Workspace(tmp_path), address=server.address)
    startup.wait_for_change()  # it is being prepared
    if before:
        startup.hand_over(taken.append)
    with serving(server):
        eventually(lambda: states(startup)[-1] == "done", "the start to end", lambda: states(startup))
        if not before:
            startup.hand_over(taken.append)
        eventually(lambda: taken, "the rally to be handed over")
        (live,) = taken
        assert live.source.status == "connected" or live.source.welcome.session
        startup.stop()
        live.close()


def test_a_source_that_is_there_is_handed_over_without_a_simulation_and_closed_with_the_rally(
    tmp_path, serve_recording
) -> None:
    source, taken = ReplaySource(open_recording(serve_recording), "serve.h5", speed=20.0), []
    startup = Startup(Workspace(tmp_path), source=source)
    startup.hand_over(taken.append)
    eventually(lambda: taken, "the rally to be handed over")
    (live,) = taken
    assert [step.title for step in startup.preparation.steps] == [REPLAY_STEPS[name].title for name in REPLAY_STEPS]
    assert live.simulation is None and not live.has_robot and set(live.cameras) == {"left", "right"}
    eventually(lambda: live.recording.duration_us > 0, "events")
    startup.stop()
    assert source.status == "connected", "it belongs to the rally now"
    live.close()
    assert source.status == "lost"


def test_a_source_that_nobody_took_is_closed_and_so_is_the_robot(tmp_path, serve_recording) -> None:
    source = ReplaySource(open_recording(serve_recording), "serve.h5")
    robot = RobotClient("tcp://127.0.0.1:1")
    Startup(Workspace(tmp_path), source=source, robot=robot).stop()
    eventually(lambda: source.status == "lost", "the source to be closed")
    eventually(lambda: robot.status.stop, "the robot to be stopped")
    assert robot.status.stop is not None and robot.status.stop.reason == "Rallyscope was ended"


def test_the_detector_is_compiled_after_the_first_picture(tmp_path, monkeypatch) -> None:
    begun = threading.Event()
    monkeypatch.setattr("app.startup.startup.marker", lambda: tmp_path / "never-compiled")
    monkeypatch.setattr("app.startup.startup.PICTURE_WITHIN_S", PATIENCE_S)
    monkeypatch.setattr(Startup, "_run_child", lambda self, name, *command: begun.set() or "")
    startup = Startup(Workspace(tmp_path), address="tcp://127.0.0.1:1")
    assert startup.preparation.is_first
    startup.wait_for_change()
    assert not begun.is_set() and states(startup)[1] == "running"
    startup.preparation.picture_is_shown.set()
    eventually(begun.is_set, "the detector to be compiled", lambda: states(startup))
    startup.stop()


def test_nobody_waits_for_a_picture_where_all_is_compiled(tmp_path, monkeypatch) -> None:
    (tmp_path / "compiled").touch()
    monkeypatch.setattr("app.startup.startup.marker", lambda: tmp_path / "compiled")
    startup = Startup(Workspace(tmp_path), address="tcp://127.0.0.1:1")
    assert not startup.preparation.is_first
    eventually(lambda: states(startup)[1] == "done", "the detector", lambda: states(startup))
    assert not startup.preparation.picture_is_shown.is_set()
    startup.stop()
