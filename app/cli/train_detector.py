"""`rallyscope train-detector yolo`: train the detector that looks at pictures, score it and write its weights.

The training itself is in the folder benchmarks/ of a checkout: who only uses a detector does not need it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from app.cli.arguments import PositiveInt, flag, given, positional, setting_flag
from app.cli.bench import load_from_checkout
from app.cli.ending import end_event
from app.cli.files import check_folder
from app.cli.progress import progress_bar
from app.cli.terminal import say
from app.formatting import share_text
from core.config import load_config
from core.detection.yolo.config import DetectorTrainingConfig, Precision, YoloConfig
from core.errors import CommandError
from core.extras import require_package


def input_size(text: str) -> tuple[int, int]:
    """Width and height from a word such as 640x384.

    Raises:
        CommandError: if it is none.
    """
    try:
        width, height = (int(part) for part in text.split("x"))
    except ValueError as error:
        raise CommandError("not a size", expected="WIDTHxHEIGHT", got=repr(text), where="--input-size") from error
    return width, height


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainDetectorArguments:
    """Train a detector on pictures. The same command goes on where it was ended."""

    name: Literal["yolo"] = positional("which detector", "yolo")
    out: Path = flag("the weights; beside them is kept what an ended training needs", "WEIGHTS")
    data: Path | None = flag(
        "folder of recordings with pictures and the truth to train on", "DATASET", "rendered rooms"
    )
    config: Path | None = flag("settings, a TOML file", "FILE")
    steps: PositiveInt | None = setting_flag(DetectorTrainingConfig, "steps", "N", "training steps")
    rooms: PositiveInt | None = setting_flag(DetectorTrainingConfig, "rooms", "N")
    seed: int | None = setting_flag(DetectorTrainingConfig, "seed", "N")
    input_size: str | None = flag("input size of the network", "WIDTHxHEIGHT", "640x384")
    precision: Precision | None = setting_flag(DetectorTrainingConfig, "precision")
    device: str = flag("auto|cpu|cuda; auto takes a GPU if torch sees one", "NAME", "auto")
    force: bool = flag("replace the weights if they exist")
    json: bool = flag("print a summary as JSON")


def run(arguments: TrainDetectorArguments) -> None:
    """Train until the end, or until interrupted: then the same command goes on."""
    require_package("torch", "training a detector")
    config = requested_training(arguments)
    check_folder(arguments.out)
    if arguments.out.exists() and not arguments.force:
        raise CommandError("the file exists", where=arguments.out, remedy="choose another name, or --force")
    if arguments.data is not None and not arguments.data.is_dir():
        raise CommandError("no such folder", got=arguments.data, where="--data")
    from core.detection.yolo.weights import MIN_RECALL, load_weights  # late: torch takes a second

    train_detector = load_from_checkout("detector_training.run").train_detector
    ended = end_event()
    with progress_bar("Training yolo") as progress:
        score = train_detector(
            arguments.out,
            config,
            data=arguments.data,
            device=arguments.device,
            progress=progress,
            cancelled=ended.is_set,
        )
    state = "stopped" if score is None else "finished"
    if arguments.json:
        found = None if score is None else {k: v if math.isfinite(v) else None for k, v in asdict(score).items()}
        say(json.dumps({"weights": str(arguments.out), "state": state, "score": found}))
        return
    if score is None:
        say(f"stopped: {arguments.out}   (the same command continues)")
        return
    confidence = load_weights(arguments.out).config.confidence
    say(f"finished: {arguments.out}, {arguments.out.stat().st_size / 1e6:.1f} MB, confidence from {confidence:g}")
    say(
        f"{score.pictures} sharp pictures it was not trained on: recall {share_text(score.recall)} and precision "
        f"{share_text(score.precision)} at 8 px, median error {score.median_error_px:.2f} px"
    )
    if not score.is_rival:
        say(f"with a recall below {MIN_RECALL:g} it is no rival: train longer, or on more rooms")


def requested_training(arguments: TrainDetectorArguments) -> DetectorTrainingConfig:
    """The training that the options describe; raises RallyscopeError for bad ones."""
    config = load_config(DetectorTrainingConfig, arguments.config) if arguments.config else DetectorTrainingConfig()
    asked = {name: getattr(arguments, name) for name in ("steps", "rooms", "seed", "precision")}
    yolo: YoloConfig = config.yolo
    if arguments.input_size is not None:
        width, height = input_size(arguments.input_size)
        yolo = dataclasses.replace(yolo, input_width_px=width, input_height_px=height)
    return dataclasses.replace(config, yolo=yolo, **given(asked))
