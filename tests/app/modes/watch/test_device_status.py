"""What is said of event cameras."""

from __future__ import annotations

from app import theme
from app.modes.watch.device_status import device_rows, lost_words
from core.devices import ClockEstimate
from core.devices.camera_feed import FeedCounts
from core.live.camera_source import CameraReport

CLOCK = ClockEstimate(0.0, 0.0, 12.34e-6, 420.0, 60_000_000)


def report(name: str, **changed) -> CameraReport:
    told = {
        "name": name, "serial": "00<1>", "model": "Prophesee EVK4", "counts": FeedCounts(events=5), "rate_hz": 1.25e6,
        "clock": CLOCK, "clock_restarts": 0, "problem": "",
    }  # fmt: skip
    return CameraReport(**(told | changed))


def test_two_cameras_that_are_well_say_their_rate_and_clocks() -> None:
    rows = dict(device_rows((report("left"), report("right", clock=None)), cable=False))
    assert rows["left"] == "Prophesee EVK4 00&lt;1&gt;, 1.2 million events/s"
    assert rows["Clock of left"] == "+12.3 ppm against this machine, packets up to 0.4 ms late"
    assert rows["Clock of right"] == "not known yet" and not any("Lost" in name for name in rows)


def test_how_the_second_clock_becomes_the_first_is_said() -> None:
    both = (report("left"), report("right", clock_restarts=2))
    assert "shifted to left's" in dict(device_rows(both, cable=False))["Clock of right"]
    said = dict(device_rows(both, cable=True))["Clock of right"]
    assert "one with left's, by cable" in said and "found anew 2 times" in said


def test_a_camera_that_is_gone_says_why() -> None:
    (row,) = device_rows((report("left", problem="1: the camera is gone; plug <it> in"),), cable=False)
    assert row[0] == "left" and theme.BAD in row[1] and "plug &lt;it&gt; in" in row[1]


def test_losses_are_said_and_nothing_where_there_are_none() -> None:
    assert lost_words(FeedCounts(events=10)) == ""
    said = lost_words(FeedCounts(packets_dropped=1200, gaps=3, events_given_up=4, packets_refused=1))
    assert said.startswith("1,200 USB packets") and "4 events that came too late" in said and "1 packets" in said
    assert lost_words(FeedCounts(gaps=3)) == "3 gaps in what the camera sent"
