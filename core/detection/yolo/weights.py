"""Weights of the network as a safetensors file: numbers and plain text, nothing in it is ever executed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from core.config import config_from_mapping, config_to_mapping
from core.detection.yolo.config import YoloConfig
from core.detection.yolo.network import YoloTiny
from core.errors import WRITE_REMEDY, ConfigError, RallyscopeError
from core.files import replace_file
from core.text import parse_json

FORMAT: Final = "rallyscope-yolo-1"
SHIPPED: Final = Path(__file__).with_name("weights.safetensors")
"""Weights shipped with the package, if any."""
KERNEL: Final = 4
"""Axes of a convolution's weights: all but a thousandth of the numbers."""
MIN_RECALL: Final = 0.9
"""Smallest recall on sharp pictures for a fair comparison: below it training, not blur, decides."""


@dataclass(frozen=True, slots=True)
class SharpScore:
    """Score of the network on pictures of 0.5 ms exposure that it was not trained on."""

    recall: float
    """Share of the pictures with the whole ball in view that have an answer within 8 px."""
    precision: float
    """Share of the answers that are within 8 px of a ball."""
    median_error_px: float
    pictures: int
    """Pictures with the whole ball in view."""
    seed: int

    @property
    def is_rival(self) -> bool:
        """Whether its recall on sharp pictures is high enough for a comparison."""
        return self.recall >= MIN_RECALL


@dataclass(frozen=True, slots=True, eq=False)
class YoloWeights:
    """A trained network with its training config and score."""

    network: YoloTiny
    """In evaluation mode."""
    config: YoloConfig
    score: SharpScore | None
    """Score; None if it was not measured."""
    training: dict[str, object]
    """The training's config as plain values."""


def save_weights(path: Path, weights: YoloWeights) -> None:
    """Write the weights atomically, convolutions in half precision: 12 MB for the published size."""
    score = weights.score
    about = {
        "format": FORMAT,
        "config": json.dumps(config_to_mapping(weights.config)),
        "score": json.dumps(None if score is None else {name: getattr(score, name) for name in SharpScore.__slots__}),
        "training": json.dumps(weights.training),
    }
    tensors = {
        name: (value.half() if value.ndim == KERNEL else value).contiguous().cpu()
        for name, value in weights.network.state_dict().items()
    }
    try:
        replace_file(path, save(tensors, about), durable=True)
    except OSError as error:
        raise ConfigError("cannot write the weights", got=error.strerror, where=path, remedy=WRITE_REMEDY) from error


def load_weights(path: Path | None = None) -> YoloWeights:
    """A trained network, by default the one that comes with the package.

    Raises:
        ConfigError: if there is no such file, it is damaged, or it is not of this network.
    """
    path, remedy = path or SHIPPED, "make one with `rallyscope train-detector yolo --out FILE`"
    if not path.is_file():
        raise ConfigError("no weights for `yolo`", expected="a safetensors file", where=path, remedy=remedy)
    try:
        with safe_open(path, "pt") as file:
            about = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
        if about.get("format") != FORMAT:
            raise ConfigError("not weights of `yolo`", expected=FORMAT, got=about.get("format"))
        config = config_from_mapping(YoloConfig, parse_json(about["config"]), where=str(path))
        score = parse_json(about["score"])
        network = YoloTiny(config.width).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        network.load_state_dict({name: value.float() if value.is_floating_point() else value
                                 for name, value in tensors.items()})  # fmt: skip
        found = YoloWeights(network.eval(), config, score and SharpScore(**score), parse_json(about["training"]))
    except (OSError, SafetensorError, KeyError, ValueError, TypeError, RuntimeError, RallyscopeError) as error:
        got = str(error).splitlines()[0]
        raise ConfigError("these weights cannot be used", got=got, where=path, remedy=remedy) from error
    return found
