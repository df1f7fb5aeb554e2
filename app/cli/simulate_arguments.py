"""The arguments of `rallyscope simulate`: of a single recording, and of a data set."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from app.cli.arguments import Names, Numbers, PositiveInt, flag, given, setting_flag
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.cameras import Sensor
from app.cli.constants import CONSTANTS_HELP
from app.cli.scenes import SceneArguments
from core.cameras.presets import CORNERS, PLACEMENTS, SENSOR_720
from core.data_sets import PRESETS
from core.data_sets.plan import PAPER_SPEEDS_MPS
from core.errors import CommandError
from core.physics.config import Profile
from core.simulation import LaunchConfig, SensorConfig
from core.simulation.frames import FrameConfig

SERVES = 3
"""Serves of a recording, by default."""
SPEEDS = ",".join(f"{speed:g}" for speed in PAPER_SPEEDS_MPS)


@dataclass(frozen=True, slots=True, kw_only=True)
class DataSetArguments:
    """What makes a data set of it, and what goes with that only."""

    TITLE: ClassVar = "data sets: a folder of recordings; lists are comma-separated"
    speeds: Numbers | None = flag("a recording each", "MPS,MPS...", SPEEDS)
    scenes: Names | None = flag("every speed in each", "SCENE,SCENE...", "ball")
    recordings_per: PositiveInt | None = flag("of every scene and speed", "N", 1)
    preset: str | None = flag("a data set with a name, instead of lists", "|".join(PRESETS))

    @property
    def asked(self) -> bool:
        """Whether there is a list or a preset."""
        return any(asked is not None for asked in (self.speeds, self.scenes, self.preset))


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateArguments:
    """Make a recording, or a data set, with the simulated event cameras."""

    out: Path = flag("the recording, or data set, to make", "REC.h5|DIR")
    serves: PositiveInt | None = flag("of a recording", "N", SERVES)
    speed: float | None = setting_flag(LaunchConfig, "speed_mps", "MPS")
    scene: SceneArguments
    cameras: str | None = flag("placement, or a calibration file", f"{'|'.join(PLACEMENTS)}|{CORNERS}|FILE", "side")
    noise_hz: float | None = setting_flag(SensorConfig, "noise_hz", "HZ")
    sensor: Sensor | None = flag("of a placement's cameras", "WxH", SENSOR_720)
    physics: Profile | None = flag("flight of the ball", "paper|real", "paper")
    constants: Path | None = flag(CONSTANTS_HELP, "FILE")
    robot: bool | None = flag(
        "let the robot, which knows every ball, play it: racket and episodes are recorded (data sets: on)"
    )
    frames_hz: float | None = flag("take colour pictures too, at this rate", "HZ", within=(FrameConfig, "rate_hz"))
    exposure_us: int | None = setting_flag(FrameConfig, "exposure_us", "N", "of the pictures")
    seed: int = flag("the same seed, the same events", "N", 0)
    force: bool = flag("replace what is there")
    json: bool = flag("print what was made as JSON")
    data_set: DataSetArguments
    engine: SharedBackendArguments

    def frames(self) -> FrameConfig | None:
        """The pictures that were asked for, if any.

        Raises:
            CommandError: if there is an exposure and no rate.
            ConfigError: if the numbers are impossible.
        """
        if self.frames_hz is not None:
            return dataclasses.replace(
                FrameConfig(), rate_hz=self.frames_hz, **given({"exposure_us": self.exposure_us})
            )
        if self.exposure_us is not None and self.data_set.preset is None:
            raise CommandError("an exposure without pictures", remedy="give --frames-hz too", where="--exposure-us")
        return None
