"""The network's output as boxes: anchors, decoding to boxes with a confidence, non-maximum suppression."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor

from core.detection.yolo.config import STRIDES

ANCHORS_PX: Final = ((18.0, 26.0, 38.0), (6.0, 9.0, 13.0))
"""Sides at the two heads (strides 32 and 16), in pixels of the input. The published ones were fitted to COCO (10 to 344
px, oblong); balls are square, and 6 to 20 px across at half size, so that these are spread evenly on a scale of
ratios: no ball is more than 1.25 times as large or small as the nearest."""
FIELDS: Final = 6
"""Fields of a box: x, y, width, height, objectness, and class (there is one: a ball)."""
SCALE_XY: Final = 1.05
"""A centre may lie slightly outside its cell, so that one on its edge can be predicted (as published)."""


LARGEST = 4.0
"""Largest logarithm of a box's size over its anchor: exp overflows on an untrained head's output."""


def split_head(raw: Tensor, scale: int) -> Tensor:
    """(B, A F, h, w) of a head as (B, A, h, w, F)."""
    anchors = len(ANCHORS_PX[scale])
    return raw.unflatten(1, (anchors, FIELDS)).permute(0, 1, 3, 4, 2)


def decode_boxes(fields: Tensor, scale: int) -> Tensor:
    """(B, A, h, w, 4): centre, width and height in pixels of the input, of the fields of `split_head`."""
    rows, columns = fields.shape[2:4]
    y, x = torch.meshgrid(
        torch.arange(rows, device=fields.device), torch.arange(columns, device=fields.device), indexing="ij"
    )
    offset = torch.sigmoid(fields[..., :2]) * SCALE_XY - (SCALE_XY - 1) / 2
    centre = (offset + torch.stack([x, y], dim=-1)) * STRIDES[scale]
    anchors = torch.tensor(ANCHORS_PX[scale], device=fields.device).view(1, -1, 1, 1, 1)
    size = anchors * torch.exp(fields[..., 2:4].clamp(max=LARGEST))
    return torch.cat([centre, size], dim=-1)


def find_boxes(heads: tuple[Tensor, Tensor], confidence: float, overlap: float) -> list[Tensor]:
    """For each picture (N, 5): centre, width, height and confidence, the most confident first."""
    boxes, sure = [], []
    for scale, raw in enumerate(heads):
        fields = split_head(raw.float(), scale)
        boxes.append(decode_boxes(fields, scale).flatten(1, 3))
        sure.append(torch.sigmoid(fields[..., 4:]).prod(dim=-1).flatten(1))
    together = torch.cat([torch.cat(boxes, dim=1), torch.cat(sure, dim=1)[..., None]], dim=-1)
    return [keep_best(one[one[:, 4] >= confidence], overlap) for one in together]


def keep_best(boxes: Tensor, overlap: float) -> Tensor:
    """Non-maximum suppression: without those that share more than `overlap` with a more confident one."""
    boxes = boxes[torch.argsort(boxes[:, 4], descending=True, stable=True)]
    kept: list[Tensor] = []
    while len(boxes):
        kept.append(boxes[0])
        boxes = boxes[1:][iou(boxes[:1, :4], boxes[1:, :4]) <= overlap]
    return torch.stack(kept) if kept else boxes.reshape(0, 5)


def iou(one: Tensor, other: Tensor) -> Tensor:
    """(...): shared area over joint area of boxes (..., 4) of centre and size."""
    low = torch.maximum(one[..., :2] - one[..., 2:] / 2, other[..., :2] - other[..., 2:] / 2)
    high = torch.minimum(one[..., :2] + one[..., 2:] / 2, other[..., :2] + other[..., 2:] / 2)
    shared = (high - low).clamp(min=0).prod(dim=-1)
    return shared / (one[..., 2:].prod(dim=-1) + other[..., 2:].prod(dim=-1) - shared).clamp(min=1e-9)
