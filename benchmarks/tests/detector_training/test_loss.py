import math

import pytest
import torch

from benchmarks.detector_training.training import ciou, yolo_loss
from core.detection.yolo.boxes import ANCHORS_PX, FIELDS

pytestmark = pytest.mark.numeric
SURE = 9.0


def heads(raw: float = -SURE, side: int = 128) -> tuple[torch.Tensor, torch.Tensor]:
    return (
        torch.full((2, 3 * FIELDS, side // 32, side // 32), raw),
        torch.full((2, 3 * FIELDS, side // 16, side // 16), raw),
    )


def right_heads(picture: int) -> tuple[tuple[torch.Tensor, torch.Tensor], torch.Tensor]:
    """Heads that say exactly where a ball of r = 4.5 px in the middle of a cell is, and that ball."""
    coarse, fine = heads()
    for anchor, side in enumerate(ANCHORS_PX[1]):
        if min(9 / side, side / 9) ** 2 >= 0.4:
            told = torch.tensor([0.0, 0.0, math.log(9 / side), math.log(9 / side), SURE, SURE])
            fine[picture, anchor * FIELDS : (anchor + 1) * FIELDS, 2, 5] = told
    return (coarse, fine), torch.tensor([[float(picture), 5.5 * 16, 2.5 * 16, 4.5]])


def test_complete_iou_of_known_boxes() -> None:
    box = torch.tensor([0.0, 0.0, 2.0, 2.0])
    others = torch.tensor([[0.0, 0.0, 2.0, 2.0], [1.0, 0.0, 2.0, 2.0], [4.0, 0.0, 2.0, 2.0]])
    apart = [0.0, 1 / (9 + 4), 16 / (36 + 4)]
    assert ciou(box, others).tolist() == pytest.approx([1.0, 1 / 3 - apart[1], 0.0 - apart[2]])
    oblong = torch.tensor([0.0, 0.0, 4.0, 1.0])
    shape = 4 / math.pi**2 * (math.atan(4) - math.atan(1)) ** 2
    shared = 2 / (4 + 4 - 2)
    assert float(ciou(oblong, box)) == pytest.approx(shared - shape**2 / (1 - shared + shape))


def test_the_loss_is_nothing_when_all_is_right_and_more_when_a_ball_is_elsewhere_or_in_another_picture() -> None:
    said, ball = right_heads(picture=1)
    right = float(yolo_loss(said, ball))
    assert right < 0.1
    moved, other_picture = ball.clone(), ball.clone()
    moved[0, 1] += 3.0
    other_picture[0, 0] = 0.0
    assert float(yolo_loss(said, moved)) > right + 0.5 and float(yolo_loss(said, other_picture)) > 10


def test_pictures_without_a_ball_teach_to_be_silent() -> None:
    nothing = torch.zeros(0, 4)
    assert float(yolo_loss(heads(), nothing)) < 0.1
    assert float(yolo_loss(heads(0.0), nothing)) > 100


def test_a_ball_of_any_size_teaches_at_least_one_anchor() -> None:
    for r in (0.5, 2.0, 5.0, 12.0, 60.0):
        assert float(yolo_loss(heads(), torch.tensor([[0.0, 40.0, 40.0, r]]))) > 5


def test_the_loss_leads_to_the_ball() -> None:
    ball = torch.tensor([[0.0, 71.0, 53.0, 5.0]])
    raw = [head[:1].clone().requires_grad_() for head in heads(-3.0)]
    optimizer = torch.optim.Adam(raw, lr=0.1)
    first = float(yolo_loss((raw[0], raw[1]), ball).detach())
    for _ in range(150):
        optimizer.zero_grad()
        loss = yolo_loss((raw[0], raw[1]), ball)
        loss.backward()
        optimizer.step()
    assert float(loss.detach()) < 0.02 * first
