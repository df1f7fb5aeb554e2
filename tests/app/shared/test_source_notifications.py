"""A lost camera and a stopped source are told once, and so is their return."""

from dataclasses import replace

from app.shared.source_notifications import HUNG_S, SLOW_AGAIN_S, SourceNotifications
from core.cameras.stereo import EpipolarDrift
from core.chain.calibration_drift import DriftReport
from core.live.stream_watch import LOST_US, CameraHealth, StreamHealth
from core.robot import RobotStatus
from core.robot.robot_watch import RobotCounts, StopNote

LEFT, RIGHT = CameraHealth("left", 0, 0, 0), CameraHealth("right", 0, 0, 0)
WELL = StreamHealth(1.0, 0.01, False, 0, (LEFT, RIGHT))


def titles(news) -> list[str]:
    return [one.title for one in news]


def test_a_lost_camera_is_told_once_and_so_is_its_return() -> None:
    news, lost = SourceNotifications(), replace(WELL, cameras=(LEFT, CameraHealth("right", 60, LOST_US, LOST_US)))
    assert news.compare("connected", WELL) == []
    assert titles(news.compare("connected", lost)) == ["Camera right is lost"]
    assert news.compare("connected", lost) == []
    (back,) = news.compare("connected", WELL)
    assert back.body == "No longer: camera right is lost." and news.compare("connected", WELL) == []


def test_a_source_that_stops_is_told_whichever_way_it_is_known() -> None:
    news, quiet = SourceNotifications(), replace(WELL, stopped=True)
    assert titles(news.compare("connected", quiet)) == ["The live source has stopped"]
    assert news.compare("lost", quiet) == []
    assert titles(news.compare("connected", WELL)) == ["Resolved"]


def test_a_change_of_scene_that_somebody_asked_for_is_no_alarm() -> None:
    news, quiet = SourceNotifications(), replace(WELL, stopped=True)
    (change,) = news.compare("lost", quiet, changes_scene=True)
    assert change.title == "Changing the scene ..." and change.color == "blue"
    assert news.compare("lost", quiet, changes_scene=True) == []
    assert news.compare("connected", WELL) == [], "nothing was wrong, so nothing is resolved"
    assert titles(news.compare("lost", quiet)) == ["The live source has stopped"]


def test_a_simulation_of_ours_that_is_only_slow_is_no_alarm_until_it_hangs_or_ends() -> None:
    news, quiet = SourceNotifications(), replace(WELL, stopped=True, quiet_s=2.0)
    (slow,) = news.compare("lost", quiet, lives=True)
    assert slow.title == "The simulation is slow" and slow.color == "blue"
    assert news.compare("connected", WELL, lives=True) == [], "nothing was wrong, so nothing is resolved"
    hung = replace(quiet, quiet_s=HUNG_S)
    (stopped,) = news.compare("connected", hung, lives=True)
    assert stopped.title == "The live source has stopped" and stopped.color == "red"
    assert titles(SourceNotifications().compare("lost", quiet)) == ["The live source has stopped"]


def test_a_simulation_that_hesitates_again_and_again_is_reported_as_slow_once() -> None:
    news, quiet = SourceNotifications(), replace(WELL, stopped=True, quiet_s=2.0)
    for wall_s in (0.0, 3.0, SLOW_AGAIN_S):
        begun = news.compare("connected", quiet, lives=True, wall_s=wall_s)
        assert titles(begun) == (["The simulation is slow"] if wall_s == 0.0 else [])
        assert news.compare("connected", WELL, lives=True, wall_s=wall_s + 1.0) == []
    begun = news.compare("connected", quiet, lives=True, wall_s=2.0 * SLOW_AGAIN_S)
    assert titles(begun) == ["The simulation is slow"], "it was quick for a minute"


def robot(connection: str, stop: StopNote | None = None, stops: int = 0) -> RobotStatus:
    counts = RobotCounts(stops=stops)
    return RobotStatus("tcp://127.0.0.1:5600", connection, "", "arm", None, None, stop, None, None, "", counts)  # type: ignore[arg-type]


def test_a_robot_that_is_lost_or_stops_by_itself_is_told_and_one_that_nobody_has_started_is_not() -> None:
    news = SourceNotifications()
    waiting = StopNote("robot", "not started yet")
    assert news.compare("connected", WELL, robot("ready", waiting)) == []
    assert titles(news.compare("connected", WELL, robot("lost"))) == ["The robot is lost"]
    assert titles(news.compare("connected", WELL, robot("ready"))) == ["Resolved"]
    (stopped,) = news.compare("connected", WELL, robot("ready", StopNote("robot", "<b>door</b>"), stops=1))
    assert stopped.title == "The robot has stopped" and stopped.body.startswith("&lt;b&gt;door")
    assert titles(news.compare("connected", WELL, robot("ready", StopNote("rallyscope", "a person"), 2))) == [
        "Resolved"
    ]


def test_a_moved_camera_is_told_once_however_its_figure_changes_and_so_is_the_end_of_it() -> None:
    news, pair = SourceNotifications(), ("left", "right")
    fits = DriftReport(200, 200, pair, EpipolarDrift(0.2, 0.1, 0.02))
    moved = [DriftReport(200, 200, pair, EpipolarDrift(px, 0.1, 0.02), alarm=True) for px in (1.2, 1.3)]
    assert news.compare("connected", WELL, None, fits) == []
    (told,) = news.compare("connected", WELL, None, moved[0])
    assert told.title == "The calibration has drifted" and "calibrate again" in told.body
    assert news.compare("connected", WELL, None, moved[1]) == []
    assert titles(news.compare("connected", WELL, None, fits)) == ["Resolved"]
