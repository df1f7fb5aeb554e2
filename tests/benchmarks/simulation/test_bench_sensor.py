"""The bench of the sensor model: clips see what they are named after, and the report says what was measured."""

import dataclasses

import pytest

from benchmarks.simulation.bench_sensor import CLIPS, KS_BOUND, measure_sensor, write_sensor_report
from core.events import SensorSize

SMALL = SensorSize(80, 60)
BY_NAME = {clip.name: clip for clip in CLIPS}


@pytest.mark.parametrize("name", ["low contrast", "ball and the robot's racket", "two persons: who walks by"])
def test_a_clip_has_events_and_is_within_the_bounds(name) -> None:
    row = measure_sensor(dataclasses.replace(BY_NAME[name], duration_us=20_000), SMALL)
    assert int(str(row["dense"])) > 200 and row["within"] is True
    assert float(str(row["on_ks"])) <= KS_BOUND


def test_every_clip_is_another_one_and_every_cast_is_among_them() -> None:
    assert len(BY_NAME) == len(CLIPS)
    assert {"ball", "dark", "low-contrast", "person", "two-persons", "rally", "head"} == {clip.scene for clip in CLIPS}


def test_the_report_names_what_is_out_of_bounds() -> None:
    figures = {"dense": 1000, "on_ratio": 1.0, "on_ks": 0.01, "off_ratio": 1.2, "off_ks": 0.2}
    text = write_sensor_report(
        [{"clip": "a", **figures, "within": False}, {"clip": "b", **figures, "within": True}], {}
    )
    assert "| a | 1,000 | 1.000 | 0.0100 | 1.200 | 0.2000 | **no** |" in text and "1 of 2 clips" in text
