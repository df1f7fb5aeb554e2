"""What a data set is to hold: one frozen entry per recording, each with a name and a seed of its own."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from core.cameras.presets import PRESETS as CAMERA_PRESETS
from core.cameras.presets import SENSOR_720
from core.config import config_to_mapping
from core.errors import ConfigError
from core.events import SensorSize
from core.physics.config import Profile, physics_profile
from core.simulation import LaunchConfig, SceneConfig, SensorConfig, scene_named
from core.simulation.frames import FrameConfig

_NAMESPACE: Final = uuid.UUID("5f6f1d3e-53f4-4f0e-8f5b-0d6a2d1c9a70")
PAPER_SPEEDS_MPS: Final = (5.0, 6.0, 7.0, 8.0, 9.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Making:
    """What all recordings of a data set have in common."""

    sensor: SensorSize = SENSOR_720
    noise_hz: float | None = None
    """Background events per pixel and second; None for the sensor model's own."""
    physics: Profile = "paper"
    frames: FrameConfig | None = None
    """Pictures beside the events."""
    wall: float | None = None
    """Brightness of the walls; None for that of the scene, as in the next two, see `SceneConfig`."""
    flicker: float | None = None
    flicker_hz: float | None = None

    def __post_init__(self) -> None:
        physics_profile(self.physics)
        self.sensor_config()

    @property
    def scene_changes(self) -> dict[str, float]:
        """What is otherwise than in the named scenes."""
        changes = {"wall": self.wall, "flicker": self.flicker, "flicker_hz": self.flicker_hz}
        return {name: value for name, value in changes.items() if value is not None}

    def scene_config(self, name: str) -> SceneConfig:
        """The scene of that name with these changes."""
        return dataclasses.replace(scene_named(name), **self.scene_changes)

    def sensor_config(self) -> SensorConfig:
        """The sensor model with this noise."""
        return SensorConfig() if self.noise_hz is None else SensorConfig(noise_hz=self.noise_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """One recording: `<name>.h5`."""

    name: str
    scene: str
    placement: str
    speeds_mps: tuple[float, ...]
    """A serve each, or in the scene `rally` a rally each."""
    robot: bool
    """Whether the built-in controller plays the serves."""
    seed: int
    making: Making = field(default_factory=Making)

    def __post_init__(self) -> None:
        if self.placement not in CAMERA_PRESETS:
            raise ConfigError(f"no placement {self.placement!r}", expected=f"one of {', '.join(CAMERA_PRESETS)}")
        for speed_mps in self.speeds_mps:
            LaunchConfig(speed_mps=speed_mps)
        if self.making.scene_config(self.scene).cast == "rally" and self.making.physics != "paper":
            raise ConfigError("a rally of two players flies without air", expected="physics paper", where="scene rally")

    @property
    def settings(self) -> dict[str, object]:
        """All that decides what is in the recording, as plain values."""
        making = self.making
        return {
            "name": self.name,
            "scene": self.scene,
            "placement": self.placement,
            "speeds_mps": list(self.speeds_mps),
            "robot": self.robot,
            "seed": self.seed,
            "sensor": str(making.sensor),
            "noise_hz": making.sensor_config().noise_hz,
            "physics": making.physics,
            "scene_changes": making.scene_changes,
            "frames": None if making.frames is None else config_to_mapping(making.frames),
        }

    @property
    def uuid(self) -> str:
        """Labels refer to it; a recording that is made again with the same settings keeps them."""
        return str(uuid.uuid5(_NAMESPACE, json.dumps(self.settings, sort_keys=True)))


@dataclass(frozen=True, slots=True)
class DataSetPlan:
    """The recordings of a data set, in order."""

    title: str
    seed: int
    recordings: tuple[PlannedRecording, ...]

    def __post_init__(self) -> None:
        names = [planned.name for planned in self.recordings]
        if not names:
            raise ConfigError("a data set without recordings")
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ConfigError("a recording is planned twice", got=twice, remedy="name every speed and scene once")


def plan_data_set(
    *,
    speeds_mps: Sequence[float] = PAPER_SPEEDS_MPS,
    scenes: Sequence[str] = ("ball",),
    placements: Sequence[str] = ("side",),
    recordings_per: int = 1,
    serves: int = 3,
    robot: bool = True,
    seed: int = 0,
    making: Making | None = None,
) -> DataSetPlan:
    """Every scene at every speed from every placement, `recordings_per` times. Two players of a rally need no robot.

    Args:
        speeds_mps: of the serves at the launcher.
        scenes: names of scenes.
        placements: names of camera placements.
        recordings_per: recordings of each combination.
        serves: serves in a recording.
        robot: whether a robot plays them back.
        seed: from which, and its name, each recording has its own.
        making: physics, sensor and frames; None: the defaults.

    Raises:
        ConfigError: if there is no such scene, placement or speed, or one is named twice.
    """
    making = making or Making()
    recordings = []
    for scene, speed_mps, placement in itertools.product(scenes, speeds_mps, placements):
        for number in range(1, recordings_per + 1):
            name = f"{scene}-{speed_mps:g}mps-{placement}-{number}"
            recordings.append(
                PlannedRecording(
                    name=name,
                    scene=scene,
                    placement=placement,
                    speeds_mps=(float(speed_mps),) * serves,
                    robot=robot and scene_named(scene).cast != "rally",
                    # Of its name: a scene more does not change the other recordings.
                    seed=recording_seed(seed, name),
                    making=making,
                )
            )
    return DataSetPlan("simulated recordings", seed, tuple(recordings))


def recording_seed(seed: int, name: str) -> int:
    """From the data set's seed and the recording's name alone: more recordings, or other jobs, change no other one."""
    named = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return int(np.random.SeedSequence([seed, named]).generate_state(1, np.uint64)[0] >> np.uint64(1))


PAPER7_FRAMES: Final = FrameConfig(rate_hz=30.0, exposure_us=5000)
PAPER7: Final[tuple[tuple[str, str, tuple[float, ...]], ...]] = (
    ("ball", "side", (5.0, 6.0, 7.0)),
    ("ball", "ceiling", (6.0, 7.0, 8.0)),
    ("ball", "behind", (7.0, 8.0, 9.0)),
    ("person", "behind", (5.0, 6.0, 7.0)),
    ("two-persons", "side", (5.0, 6.0, 7.0)),
    ("two-persons", "behind", (6.0, 7.0, 8.0)),
    ("rally", "behind", (5.0,)),
)
"""Scene, placement and speeds (choice) of what stands for the paper's seven real recordings: three with the ball only,
four with moving people, the last one a rally of two players (five strokes); several placements of the cameras."""


def paper7(seed: int, making: Making) -> DataSetPlan:
    """`real1` to `real7`, after the recordings of the paper. No robot: the paper names none in them."""
    recordings = []
    for number, (scene, placement, speeds_mps) in enumerate(PAPER7, start=1):
        name = f"real{number}"
        recordings.append(
            PlannedRecording(
                name=name,
                scene=scene,
                placement=placement,
                speeds_mps=speeds_mps,
                robot=False,
                seed=recording_seed(seed, name),
                making=making,
            )
        )
    return DataSetPlan("seven recordings after the paper's real ones", seed, tuple(recordings))


PRESETS: Final[dict[str, tuple[Callable[[int, Making], DataSetPlan], FrameConfig]]] = {
    "paper7": (paper7, PAPER7_FRAMES)
}
"""How each preset is planned, and the pictures it takes unless told otherwise."""


def preset_plan(name: str, seed: int, making: Making) -> DataSetPlan:
    """The plan of a preset.

    Raises:
        ConfigError: if there is no such preset, or it cannot be made this way.
    """
    if name not in PRESETS:
        raise ConfigError(f"no preset {name!r}", expected=f"one of {', '.join(PRESETS)}")
    return PRESETS[name][0](seed, making)
