"""`--constants FILE`: air and table as `fit-physics` fitted them, for whatever flies or predicts a ball."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from core.errors import CommandError
from core.physics.config import Profile
from core.physics.constants_file import FittedConstants, read_constants

CONSTANTS_OF_BALL: Final = "drag, restitution and friction as `fit-physics --out` fitted them to real flights"
CONSTANTS_HELP: Final = f"{CONSTANTS_OF_BALL}, instead of --physics"


def given_constants(
    path: Path | None, physics: Profile | None = None, prediction: str = "filter"
) -> FittedConstants | None:
    """The constants of the flag's file; None without one. They replace those of the physics `real`.

    Raises:
        CommandError: if the physics or the prediction is the paper's, which has its own.
        ConfigError: if the file holds no constants.
    """
    if path is None:
        return None
    if physics == "paper":
        remedy = "leave --physics out, or say real"
        raise CommandError("the physics `paper` has fixed constants", where="--constants", remedy=remedy)
    if prediction == "paper":
        remedy = "leave it out, or take the filter"
        raise CommandError("the paper's prediction has fixed constants", where="--constants", remedy=remedy)
    return read_constants(path)
