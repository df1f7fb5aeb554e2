"""What is said of a robot of one's own."""

from dataclasses import replace

from app import theme
from app.modes.watch.robot import limits_words, robot_html
from core.chain.control.step_test import CommandLatency
from core.robot import RobotState, RobotStatus
from core.robot.robot_step_test import StepTestReport
from core.robot.robot_watch import ClockOffset, RobotCounts, StopNote
from tests.core.robot.limits import LIMITS

STATE = RobotState(
    session="s", t_us=1, p_m=(-1.6, 0.0, 0.25), q_wxyz=(1.0, 0.0, 0.0, 0.0), v_mps=(3.0, 4.0, 0.0),
    following=0, stopped="", reason="",
)  # fmt: skip
AWAITED = RobotStatus("tcp://127.0.0.1:5600", "awaited", "nobody has answered yet", "", None, None,
    StopNote("rallyscope", "not started yet"), None, None, "", RobotCounts())  # fmt: skip
PLAYING = replace(
    AWAITED, connection="ready", problem="", name="<b>arm", limits=LIMITS, state=STATE, stop=None, round_trip_ms=2.14,
    clock=ClockOffset(1e9, 510.0), counts=RobotCounts(sent=12, taken=10, refused=2, kept_back=3),
)  # fmt: skip

NOT_TESTED = StepTestReport()


def test_one_that_is_not_there_yet_is_no_fault() -> None:
    said = robot_html(AWAITED, NOT_TESTED)
    assert "tcp://127.0.0.1:5600: nobody has answered yet. No targets are sent" in said
    assert theme.BAD not in said and "stopped by Rallyscope: not started yet" in said and "Racket" not in said


def test_one_that_plays_says_where_it_is_what_it_may_do_and_what_it_took() -> None:
    said = robot_html(PLAYING, NOT_TESTED)
    assert "&lt;b&gt;arm, connected, answers in 2.1 ms, its clock known to 0.5 ms" in said and "<b>arm" not in said
    assert "x -1.600, y +0.000, z +0.250 m, 5.00 m/s" in said and limits_words(LIMITS) in said
    assert "10 taken, 2 refused by the robot, 3 held back: too late or outside the limits" in said
    assert "yes" in said and "Last refusal" not in said and "Until now" not in said
    assert limits_words(LIMITS).startswith("x -2.2 to -1, y -1 to 1, z 0.02 to 0.9 m; 5 m/s, 80 m/s&sup2;, 20 rad/s")


def test_who_stopped_it_and_why_is_said_without_its_markup() -> None:
    said = robot_html(replace(PLAYING, stop=StopNote("robot", "<i>door</i>")), NOT_TESTED)
    assert "no, stopped by the robot itself: &lt;i&gt;door&lt;/i&gt;" in said
    both = replace(PLAYING, stop=AWAITED.stop, state=replace(STATE, stopped="robot", reason="red button"))
    assert "stopped by Rallyscope: not started yet. The robot itself: red button" in robot_html(both, NOT_TESTED)


def test_one_that_is_lost_is_red_and_its_losses_are_counted() -> None:
    counts = RobotCounts(lost=2, slow=3, clock_jumps=1)
    lost = replace(PLAYING, connection="lost", problem="lost: nothing heard for 3 s", counts=counts, last_refusal="<x>")
    said = robot_html(lost, NOT_TESTED)
    assert "paused; continues when it is back" in said
    assert theme.BAD in said and "&lt;b&gt;arm: lost: nothing heard for 3 s" in said and "Racket<" not in said
    assert "2 x lost, 3 x slow, 1 x clock jumped" in said and "&lt;x&gt;" in said


def test_how_late_it_is_is_said_with_its_uncertainty_and_why_a_test_ended() -> None:
    assert "unknown: Step test measures it" in robot_html(PLAYING, NOT_TESTED)
    assert "measuring, 30 %" in robot_html(PLAYING, StepTestReport(running=True, done=0.3))
    found = StepTestReport(found=CommandLatency(0.0352, 0.0004, 0.0012, 10))
    said = robot_html(PLAYING, found)
    assert "35.2 &plusmn; 0.4 ms, 1.2 ms from one of 10 steps to another: commands are sent this much earlier" in said
    assert theme.GOOD in said and "aborted" not in said
    broken = robot_html(PLAYING, replace(found, problem="<a> ball flies"))
    assert "aborted: &lt;a&gt; ball flies" in broken and "35.2" in broken
