"""The training loop: each step's crops depend on the seed and the step alone; regular checkpoints.

The loss of YOLOv4: complete IoU of the boxes that have a ball, and cross-entropy of whether there is one. CIoU: Zheng
et al. 2020 (arXiv 1911.08287). A ball is the business of every anchor of its size, in the cell with its centre; other
boxes that lie on it by chance are neither right nor wrong.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from benchmarks.detector_training.crops import CropBatch, draw_batch
from benchmarks.detector_training.pool import TrainingPictures
from core.config import config_to_mapping
from core.detection.yolo.boxes import ANCHORS_PX, decode_boxes, iou, split_head
from core.detection.yolo.config import STRIDES, DetectorTrainingConfig
from core.detection.yolo.detector import WHITE
from core.detection.yolo.network import YoloTiny
from core.errors import ConfigError
from core.files import replace_file
from core.text import parse_json

BOX_WEIGHT: Final = 3.0
"""Weight of the boxes' loss against the cross-entropies."""
SAME_SIZE: Final = 0.4
"""Smallest intersection over union of an anchor and a ball about one centre for the anchor to be responsible."""
ON_IT: Final = 0.5
"""Intersection over union from which a box without a ball is not penalised."""


def ciou(one: Tensor, other: Tensor) -> Tensor:
    """(...): IoU less the distance of the centres and the difference of the shapes; 1 for equal boxes (..., 4)."""
    low = torch.minimum(one[..., :2] - one[..., 2:] / 2, other[..., :2] - other[..., 2:] / 2)
    high = torch.maximum(one[..., :2] + one[..., 2:] / 2, other[..., :2] + other[..., 2:] / 2)
    diagonal = ((high - low) ** 2).sum(dim=-1).clamp(min=1e-9)
    apart = ((one[..., :2] - other[..., :2]) ** 2).sum(dim=-1) / diagonal
    turn = torch.atan(one[..., 2] / one[..., 3].clamp(min=1e-9)) - torch.atan(
        other[..., 2] / other[..., 3].clamp(min=1e-9)
    )
    shape = 4 / math.pi**2 * turn**2
    shared = iou(one, other)
    with torch.no_grad():
        weight = shape / (1 - shared + shape).clamp(min=1e-9)
    return shared - apart - weight * shape


def yolo_loss(heads: tuple[Tensor, Tensor], circles: Tensor) -> Tensor:
    """Loss of raw heads against balls (N, 4): picture in the batch, centre and radius in input pixels."""
    number = circles[:, 0].long()
    truth = torch.cat([circles[:, 1:3], 2 * circles[:, 3:], 2 * circles[:, 3:]], dim=1)
    sides = truth[:, 2]
    anchors = torch.tensor(ANCHORS_PX, device=circles.device)
    ratio = sides[:, None, None] / anchors
    alike = torch.minimum(ratio, 1 / ratio.clamp(min=1e-9)) ** 2
    """(N, 2, A)"""
    best = alike.flatten(1).argmax(dim=1)
    chosen = alike >= SAME_SIZE
    chosen.flatten(1)[torch.arange(len(best)), best] = True

    boxes_lost, object_lost, class_lost = [], [], []
    for scale, raw in enumerate(heads):
        fields = split_head(raw.float(), scale)
        boxes = decode_boxes(fields, scale)
        right = torch.zeros_like(fields[..., 4])
        blamed = torch.ones_like(right)
        with torch.no_grad():
            for ball, picture in enumerate(number.tolist()):
                blamed[picture][iou(boxes[picture], truth[ball]) > ON_IT] = 0.0
        ball, anchor = torch.nonzero(chosen[:, scale], as_tuple=True)
        cells = (truth[ball, :2] / STRIDES[scale]).long()
        column = cells[:, 0].clamp(0, fields.shape[3] - 1)
        row = cells[:, 1].clamp(0, fields.shape[2] - 1)
        place = (number[ball], anchor, row, column)
        right[place] = 1.0
        blamed[place] = 1.0
        boxes_lost.append(1 - ciou(boxes[place], truth[ball]))
        object_lost.append((binary_cross_entropy_with_logits(fields[..., 4], right, reduction="none") * blamed).sum())
        of_class = fields[..., 5][place]
        class_lost.append(binary_cross_entropy_with_logits(of_class, torch.ones_like(of_class), reduction="none"))
    placed = max(1, sum(len(one) for one in boxes_lost))
    return (BOX_WEIGHT * torch.cat(boxes_lost).sum() + torch.cat(class_lost).sum() + sum(object_lost)) / placed


CROPS_STREAM: Final = 0x63726F70
MOMENTS: Final = ("step", "exp_avg", "exp_avg_sq")
"""State of AdamW for each weight."""
CLIP: Final = 10.0
"""Longest gradient."""
Progress = Callable[[float], None]


@dataclass(eq=False)
class TrainingState:
    """A network in training. `run_steps` changes it."""

    network: YoloTiny
    optimizer: torch.optim.AdamW
    step: int
    losses: list[float]
    """Loss of every step so far."""
    plans: list[tuple[int, int]]
    """Planned numbers of steps by first step: a resumed training may have a new plan."""


def new_state(config: DetectorTrainingConfig, device: str) -> TrainingState:
    """First weights; the same seed gives the same ones."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        network = YoloTiny(config.yolo.width)
    network.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, foreach=False
    )
    return TrainingState(network, optimizer, 0, [], [(0, config.steps)])


def run_steps(
    state: TrainingState,
    config: DetectorTrainingConfig,
    pool: TrainingPictures,
    *,
    device: str = "cpu",
    checkpoint: Path | None = None,
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> bool:
    """Train up to the last step; False if cancelled before. The state is kept in `checkpoint`, then and now and then.

    Raises:
        ConfigError: if there is no picture to train on.
    """
    rows = pool.rows()
    if not len(rows):
        raise ConfigError("no pictures to train on")
    state.network.train()
    while state.step < config.steps:
        if cancelled():
            break
        rng = np.random.default_rng([config.seed, CROPS_STREAM, state.step])
        state.losses.append(
            _train_step(state, config, draw_batch(pool, rows, config.batch, config.crop_px, rng), device)
        )
        state.step += 1
        if checkpoint is not None and state.step % config.checkpoint_every == 0:
            save_state(checkpoint, state, config)
        progress(state.step / config.steps)
    if checkpoint is not None:
        save_state(checkpoint, state, config)
    state.network.eval()
    return state.step >= config.steps


def learning_rate(config: DetectorTrainingConfig, step: int) -> float:
    """Learning rate: linear warm-up, then cosine decay."""
    if step < config.warm_up_steps:
        return config.learning_rate * (step + 1) / config.warm_up_steps
    done = (step - config.warm_up_steps) / max(1, config.steps - config.warm_up_steps)
    return config.learning_rate * 0.5 * (1 + math.cos(math.pi * done))


def as_levels(images: NDArray[np.uint8], device: str) -> Tensor:
    """(B, 3, h, w) of 0..1 from pictures (B, h, w, 3)."""
    pixels = torch.from_numpy(images).to(device).permute(0, 3, 1, 2)
    return pixels.to(dtype=torch.float32, memory_format=torch.channels_last) / WHITE


def _train_step(state: TrainingState, config: DetectorTrainingConfig, batch: CropBatch, device: str) -> float:
    for group in state.optimizer.param_groups:
        group["lr"] = learning_rate(config, state.step)
    circles = torch.from_numpy(batch.circles).to(device=device, dtype=torch.float32)
    half = config.precision == "bfloat16"
    with torch.autocast(torch.device(device).type, dtype=torch.bfloat16, enabled=half):
        heads = state.network(as_levels(batch.images, device))
    loss = yolo_loss(heads, circles)
    state.optimizer.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(state.network.parameters(), CLIP)
    state.optimizer.step()
    return float(loss.detach())


def save_state(path: Path, state: TrainingState, config: DetectorTrainingConfig) -> None:
    """Write the complete state atomically."""
    tensors = {f"network.{name}": value for name, value in state.network.state_dict().items()}
    for number, moments in state.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": moments[name] for name in MOMENTS}
    about = {
        "step": str(state.step),
        "losses": json.dumps([round(loss, 5) for loss in state.losses]),
        "config": _described(config),
        "plans": json.dumps(state.plans),
    }
    data = save({name: value.contiguous().cpu() for name, value in tensors.items()}, about)
    try:
        replace_file(path, data, durable=True)
    except OSError as error:
        remedy = "free some space and train on: the state before this one is kept"
        raise ConfigError("the training cannot be written", got=error.strerror, where=path, remedy=remedy) from error


def load_state(path: Path, config: DetectorTrainingConfig, device: str) -> TrainingState:
    """What `save_state` kept. The number of steps may be another one: it counts from here on.

    Raises:
        ConfigError: if the file is damaged, or of a training with other settings.
    """
    state, remedy = new_state(config, device), "remove it to start over, or write the weights elsewhere"
    try:
        with safe_open(path, "pt") as file:
            about = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
        if about["config"] != _described(config):
            raise ConfigError(
                "a training with other settings was begun here", expected=_described(config), got=about["config"],
                where=path, remedy=remedy,
            )  # fmt: skip
        network = {name.removeprefix("network."): one for name, one in tensors.items() if name.startswith("network.")}
        state.network.load_state_dict(network)
        kept = state.optimizer.state_dict()
        count = len(list(state.network.parameters()))
        if any(name.startswith("optimizer.") for name in tensors):
            kept["state"] = {n: {name: tensors[f"optimizer.{n}.{name}"] for name in MOMENTS} for n in range(count)}
        state.optimizer.load_state_dict(kept)
        step, plans = int(about["step"]), [(int(begun), int(steps)) for begun, steps in parse_json(about["plans"])]
        if plans[-1][1] != config.steps:
            plans.append((step, config.steps))
        return TrainingState(state.network, state.optimizer, step, parse_json(about["losses"]), plans)
    except (OSError, SafetensorError, KeyError, ValueError, RuntimeError) as error:
        got = str(error).splitlines()[0]
        raise ConfigError("not a checkpoint of this training", got=got, where=path, remedy=remedy) from error


def _described(config: DetectorTrainingConfig) -> str:
    """All settings but the number of steps."""
    return json.dumps({**config_to_mapping(config), "steps": None}, sort_keys=True)
