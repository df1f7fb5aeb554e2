"""The tables of the task: values by serve speed."""

from __future__ import annotations

import math

import pytest

from core.physics.task import STAGE_SPEEDS_MPS, ElevationConfig, RacketSpeedConfig, task_profile

pytestmark = pytest.mark.numeric


def test_a_table_has_its_values_at_its_speeds_and_straight_lines_between_them() -> None:
    degrees = ElevationConfig(at_3_deg=1, at_4_deg=4, at_5_deg=2, at_6_deg=8, at_7_deg=5, at_8_deg=7, at_9_deg=3)
    assert [math.degrees(degrees.at(speed)) for speed in STAGE_SPEEDS_MPS] == pytest.approx([1, 4, 2, 8, 5, 7, 3])
    speeds = RacketSpeedConfig(at_3_mps=1, at_4_mps=4, at_5_mps=2, at_6_mps=7, at_7_mps=5, at_8_mps=6, at_9_mps=3)
    assert [speeds.at(speed) for speed in (2, 3, 4, 4.5, 5, 6, 7, 8, 8.25, 9, 11)] == pytest.approx(
        [1, 1, 4, 3, 2, 7, 5, 6, 5.25, 3, 3]
    )


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_the_faster_the_serve_the_slower_the_racket(profile) -> None:
    speeds = [task_profile(profile).stroke.racket_speed.at(speed) for speed in STAGE_SPEEDS_MPS]
    assert speeds == sorted(set(speeds), reverse=True)
