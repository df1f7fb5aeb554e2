"""Data sets with a name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from core.data_sets.plan import DataSetPlan, Making, PlannedRecording, recording_seed
from core.errors import ConfigError
from core.simulation.frames.frames import FrameConfig

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
