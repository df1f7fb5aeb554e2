"""Supported camera models: sensors, biases, and other features.

Sources: neuromorphic-drivers 0.18.2 for names, defaults and what each model takes; for the ranges of the EVK4's biases,
which are offsets from the factory's values, Prophesee's page "Biases" (IMX636). A camera may allow less than is said
here: its own bounds are asked for when it is opened.

Biases as TOML: a table for each camera, by model and serial number, or for each model, which serves two of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import tomli_w

from core.errors import WRITE_REMEDY, ConfigError
from core.events import SensorSize
from core.files import replace_file
from core.text import parse_toml


@dataclass(frozen=True, slots=True)
class Bias:
    """One of a camera's biases: an analogue setting of all pixels."""

    name: str
    low: int
    high: int
    default: int
    doc: str
    """Effect of a larger value."""

    def within(self, low: int, high: int) -> Bias:
        """Copy with narrower bounds."""
        low, high = max(low, self.low), min(high, self.high)
        return replace(self, low=low, high=high, default=min(max(self.default, low), high))


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Properties of a camera model."""

    name: str
    """Model name that the driver reports."""
    module: str
    """The driver's module of its configuration."""
    sensor: SensorSize
    evt3: bool
    """Whether its bytes are EVT3, which a file can hold as they come."""
    cable: bool
    """Whether two of them can share a clock over a sync cable."""
    biases: tuple[Bias, ...]
    offers: str
    """Other features, as text."""


_ON: Final = "higher: more contrast is needed for an ON event, so fewer of them and less noise"
_OFF: Final = "higher: more contrast is needed for an OFF event, so fewer of them and less noise"
_FO: Final = "higher: the pixel follows faster changes of light, with more noise; lower filters flicker and noise"
_HPF: Final = "higher: slow changes of light are filtered out, which keeps fast things only"
_REFR: Final = "higher: a pixel rests for a shorter time after an event, so more events of one edge"
_HD: Final = SensorSize(1280, 720)

EVK4: Final = CameraModel(
    "Prophesee EVK4", "prophesee_evk4", _HD, evt3=True, cable=True,
    biases=(
        Bias("diff_on", -85, 140, 0, _ON),
        Bias("diff_off", -35, 190, 0, _OFF),
        Bias("fo", -35, 55, 0, _FO),
        Bias("hpf", 0, 120, 0, _HPF),
        Bias("refr", -20, 235, 0, _REFR),
    ),
    offers="rate limit, masks of rows, columns and pixels, sync cable, trigger input, temperature, light meter",
)  # fmt: skip
EVK3_HD: Final = CameraModel(
    "Prophesee EVK3 HD", "prophesee_evk3_hd", _HD, evt3=True, cable=False,
    biases=(
        Bias("diff_on", 81, 255, 115, _ON),
        Bias("diff_off", 0, 79, 52, "lower: more contrast is needed for an OFF event, so fewer of them and less noise"),
        Bias("fo_p", 0, 255, 74, "of the low-pass filter: how fast a change of light the pixel follows"),
        Bias("hpf", 0, 255, 0, _HPF),
        Bias("refr", 0, 255, 68, "how long a pixel rests after an event"),
    ),
    offers="rate limit, masks of rows and columns",
)  # fmt: skip
DVXPLORER: Final = CameraModel(
    "iniVation DVXplorer", "inivation_dvxplorer", SensorSize(640, 480), evt3=False, cable=False,
    biases=(
        Bias("on", 0, 17, 8, _ON),
        Bias("off", 0, 17, 8, _OFF),
        Bias("amp", 0, 8, 4, "gain of the pixel's amplifier"),
        Bias("sf", 0, 3, 0, "of the source follower: how fast a change of light the pixel follows"),
    ),
    offers="trigger input, motion sensor",
)  # fmt: skip
DAVIS346: Final = CameraModel(
    "iniVation DAVIS 346", "inivation_davis346", SensorSize(346, 260), evt3=False, cable=False,
    biases=(
        Bias("onbn", 1064, 2047, 1564, _ON),
        Bias("offbn", 0, 1062, 583, "lower: more contrast is needed for an OFF event, so fewer of them and less noise"),
        Bias("prbp", 0, 2047, 575, "of the photoreceptor: higher follows faster changes of light"),
        Bias("prsfbp", 0, 2047, 153, "of the source follower behind it: higher follows faster changes of light"),
        Bias("refrbp", 0, 2047, 993, _REFR),
    ),
    offers="pictures, filter of lone pixels, region of interest, trigger input, motion sensor",
)  # fmt: skip

MODELS: Final = {model.name: model for model in (EVK4, EVK3_HD, DVXPLORER, DAVIS346)}


def check_biases(biases: tuple[Bias, ...], values: Mapping[str, int], where: object = None) -> None:
    """Let values of biases pass that a camera takes.

    Raises:
        ConfigError: if there is no such bias, or a value is no whole number within its bounds.
    """
    known = {bias.name: bias for bias in biases}
    for name, value in values.items():
        bias = known.get(name)
        if bias is None:
            raise ConfigError("no such bias", expected=" or ".join(known), got=name, where=where)
        if type(value) is not int or not bias.low <= value <= bias.high:
            expected = f"a whole number from {bias.low} to {bias.high}"
            raise ConfigError(f"bias {name} out of bounds", expected=expected, got=value, where=where)


LARGEST_BYTES: Final = 64 << 10

BiasSets = dict[str, dict[str, int]]
"""Bias values by name, by model, or by model and serial number separated by a space."""


def read_biases(path: Path) -> BiasSets:
    """The biases in a file, each within the bounds of its model.

    Raises:
        ConfigError: if it cannot be read, is no TOML, or has a model, a bias or a value that there is not.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError("cannot read the biases", got=error.strerror, where=path) from error
    if len(data) > LARGEST_BYTES:
        raise ConfigError("too long for biases", expected=f"up to {LARGEST_BYTES} bytes", got=len(data), where=path)
    try:
        tables = parse_toml(data.decode("utf-8-sig"))
    except ValueError as error:  # of TOML, and of UTF-8
        raise ConfigError("not a TOML file", got=str(error), where=path) from error
    found: BiasSets = {}
    for name, values in tables.items():
        model = MODELS.get(name) or MODELS.get(name.rpartition(" ")[0])
        if model is None or not isinstance(values, dict):
            raise ConfigError(
                "no such model of camera",
                expected=f"{' or '.join(MODELS)}, and a serial number behind it if wanted",
                got=name,
                where=path,
            )
        check_biases(model.biases, values, f"{path}, [{name}]")
        found[name] = dict(values)
    return found


def write_biases(path: Path, sets: Mapping[str, Mapping[str, int]]) -> None:
    """Write them so that `read_biases` gives them again.

    Raises:
        ConfigError: if the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, tomli_w.dumps({name: dict(values) for name, values in sets.items()}).encode(), durable=True)
    except OSError as error:
        raise ConfigError("cannot write the biases", got=error.strerror, where=path, remedy=WRITE_REMEDY) from error
