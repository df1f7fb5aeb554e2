"""`--randomise`: what differs from ball to ball, of a training and of an evaluation."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Annotated, Final, cast

from core.learning.randomisation import RANDOMISED, RandomisationConfig, Randomised, fitted_ranges
from core.physics.constants_file import FittedConstants

NOTHING: Final = "none"
RANDOMISE_METAVAR: Final = f"{','.join(RANDOMISED)}|{NOTHING}"
RANDOMISE_HELP: Final = (
    "what differs from ball to ball without the policy being told: air and table (with --constants as far as their fit"
    " left open), a racket that is late, its rubber, the cameras' calibration"
)


def read_randomised(text: str) -> tuple[Randomised, ...]:
    """Names with commas between, or `none` for nothing."""
    names = [name.strip() for name in text.split(",")]
    if names == [NOTHING]:
        return ()
    if not set(names) <= set(RANDOMISED):
        raise argparse.ArgumentTypeError(
            f"expected some of {', '.join(RANDOMISED)} with commas between, or {NOTHING}, got {text!r}"
        )
    return tuple(cast(Randomised, name) for name in names)


RandomisedNames = Annotated[tuple[Randomised, ...], read_randomised]


def randomised(
    config: RandomisationConfig, names: tuple[Randomised, ...] | None, constants: FittedConstants | None = None
) -> RandomisationConfig:
    """The config with exactly these switched on; None: as it is. Fitted constants give the ranges of air and table."""
    if constants is not None:
        config = fitted_ranges(config, constants)
    return config if names is None else dataclasses.replace(config, **{name: name in names for name in RANDOMISED})
