import dataclasses

import numpy as np
import pytest

from core.data_sets import PlannedRecording, plan_data_set, preset_plan
from core.data_sets.plan import PAPER7_FRAMES, PAPER_SPEEDS_MPS, Making, recording_seed
from core.errors import ConfigError
from core.events import SensorSize
from core.simulation.frames import FrameConfig

ONE = PlannedRecording(name="a", scene="ball", placement="side", speeds_mps=(5.0,), robot=True, seed=1)


def test_every_scene_comes_at_every_speed_from_every_placement() -> None:
    plan = plan_data_set(
        speeds_mps=(5, 6.5), scenes=("ball", "rally"), placements=("side", "behind"), recordings_per=2, serves=4
    )
    assert len(plan.recordings) == 2 * 2 * 2 * 2
    assert [planned.name for planned in plan.recordings[:3]] == [
        "ball-5mps-side-1",
        "ball-5mps-side-2",
        "ball-5mps-behind-1",
    ]
    last = plan.recordings[-1]
    assert (last.name, last.speeds_mps, last.placement) == ("rally-6.5mps-behind-2", (6.5,) * 4, "behind")
    assert {planned.scene for planned in plan.recordings if planned.robot} == {"ball"}, "two players need no robot"
    assert plan_data_set().recordings[0].robot and not plan_data_set(robot=False).recordings[0].robot
    assert tuple(planned.speeds_mps[0] for planned in plan_data_set().recordings) == PAPER_SPEEDS_MPS


def test_a_seed_follows_from_the_data_sets_seed_and_the_name_alone() -> None:
    few, many = plan_data_set(speeds_mps=(9,), seed=3), plan_data_set(scenes=("dark", "ball"), seed=3)
    by_name = {planned.name: planned for planned in many.recordings}
    assert few.recordings[0] == by_name["ball-9mps-side-1"]
    seeds = [planned.seed for planned in many.recordings]
    assert len(set(seeds)) == len(seeds) == 10 and all(0 <= seed < 2**63 for seed in seeds)
    assert recording_seed(4, "ball-9mps-side-1") not in seeds
    draws = [np.random.default_rng(seed).random() for seed in seeds]
    assert len(set(draws)) == 10


@pytest.mark.parametrize(
    "making",
    [
        Making(sensor=SensorSize(64, 48)),
        Making(noise_hz=1.0),
        Making(physics="real"),
        Making(frames=FrameConfig()),
        Making(frames=FrameConfig(exposure_us=999)),
        Making(wall=0.5),
        Making(flicker=0.1),
    ],
)
def test_an_identity_changes_with_every_setting_and_with_nothing_else(making: Making) -> None:
    other = dataclasses.replace(ONE, making=making)
    assert other.uuid != ONE.uuid and other.settings != ONE.settings
    assert dataclasses.replace(ONE).uuid == ONE.uuid
    assert dataclasses.replace(ONE, making=Making(noise_hz=0.1)).uuid == ONE.uuid, "the sensor model's own noise"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"speeds_mps": (2.0,)}, "3 to 9"),
        ({"scenes": ("moon",)}, "no scene 'moon'"),
        ({"placements": ("moon",)}, "no placement 'moon'"),
        ({"scenes": ("ball", "ball")}, "planned twice"),
        ({"speeds_mps": ()}, "without recordings"),
        ({"scenes": ("rally",), "making": Making(physics="real")}, "without air"),
    ],
)
def test_what_cannot_be_made_is_refused_before_anything_is_made(wrong: dict, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        plan_data_set(**wrong)
    with pytest.raises(ConfigError, match="out of range"):
        Making(noise_hz=-1.0)


def test_the_papers_seven_are_three_with_the_ball_and_four_with_people_of_which_one_plays_a_rally() -> None:
    plan = preset_plan("paper7", 1, Making(frames=PAPER7_FRAMES))
    assert [planned.name for planned in plan.recordings] == [f"real{number}" for number in range(1, 8)]
    scenes = [planned.scene for planned in plan.recordings]
    assert scenes[:3] == ["ball"] * 3 and set(scenes[3:]) == {"person", "two-persons", "rally"}
    assert scenes.count("rally") == 1 and len({planned.placement for planned in plan.recordings}) >= 3
    assert all(str(planned.making.sensor) == "1280x720" and planned.making.frames for planned in plan.recordings)
    with pytest.raises(ConfigError, match="no preset 'paper8'"):
        preset_plan("paper8", 1, Making())
