"""The loss of YOLOv4: complete IoU of the boxes that have a ball, and cross-entropy of whether there is one.

CIoU: Zheng et al. 2020 (arXiv 1911.08287). A ball is the business of every anchor of its size, in the cell with its
centre; other boxes that lie on it by chance are neither right nor wrong.
"""

from __future__ import annotations

import math
from typing import Final

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from core.detection.yolo.anchors import ANCHORS_PX
from core.detection.yolo.boxes import decode_boxes, iou, split_head
from core.detection.yolo.config import STRIDES

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
