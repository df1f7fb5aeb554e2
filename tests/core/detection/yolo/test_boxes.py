"""What the heads say, on tensors made by hand."""

import math

import pytest
import torch

from core.detection.yolo.boxes import ANCHORS_PX, FIELDS, SCALE_XY, decode_boxes, find_boxes, iou, keep_best, split_head


def silent_heads(height: int = 384, width: int = 640) -> tuple[torch.Tensor, torch.Tensor]:
    """Heads that are sure of nothing."""
    channels = 3 * FIELDS
    return (
        torch.full((1, channels, height // 32, width // 32), -12.0),
        torch.full((1, channels, height // 16, width // 16), -12.0),
    )


def say(head: torch.Tensor, anchor: int, row: int, column: int, fields: tuple[float, ...]) -> None:
    head[0, anchor * FIELDS : (anchor + 1) * FIELDS, row, column] = torch.tensor(fields)


@pytest.mark.parametrize("scale", [0, 1])
def test_a_box_lies_in_the_middle_of_its_cell_and_has_its_anchors_size_unless_told_otherwise(scale: int) -> None:
    head, stride = silent_heads()[scale], (32, 16)[scale]
    say(head, 2, 5, 7, (0.0, 0.0, 0.0, math.log(2.0), 4.0, 4.0))
    box = decode_boxes(split_head(head, scale), scale)[0, 2, 5, 7]
    side = ANCHORS_PX[scale][2]
    assert box.tolist() == pytest.approx([7.5 * stride, 5.5 * stride, side, 2 * side])


def test_a_centre_on_the_edge_of_a_cell_can_be_told() -> None:
    head = silent_heads()[1]
    edge = math.log((0.5 * (SCALE_XY - 1) / SCALE_XY) / (1 - 0.5 * (SCALE_XY - 1) / SCALE_XY))
    say(head, 0, 3, 4, (edge, -edge, 0.0, 0.0, 4.0, 4.0))
    box = decode_boxes(split_head(head, 1), 1)[0, 0, 3, 4]
    assert box[:2].tolist() == pytest.approx([4 * 16, 4 * 16], abs=1e-4)


def test_only_the_sure_boxes_are_found_and_the_surest_comes_first() -> None:
    coarse, fine = silent_heads()
    say(fine, 1, 10, 20, (0.0, 0.0, 0.0, 0.0, 2.0, 3.0))
    say(coarse, 0, 2, 3, (0.0, 0.0, 0.0, 0.0, 5.0, 5.0))
    say(fine, 0, 1, 1, (0.0, 0.0, 0.0, 0.0, 0.0, 5.0))
    (found,) = find_boxes((coarse, fine), 0.6, 0.3)
    sigmoid = torch.sigmoid(torch.tensor([5.0, 5.0, 2.0, 3.0]))
    assert found[:, 4].tolist() == pytest.approx([float(sigmoid[0] * sigmoid[1]), float(sigmoid[2] * sigmoid[3])])
    assert found[0, :4].tolist() == pytest.approx([3.5 * 32, 2.5 * 32, 18, 18])
    assert found[1, :4].tolist() == pytest.approx([20.5 * 16, 10.5 * 16, 9, 9])
    assert find_boxes(silent_heads(), 0.01, 0.3)[0].shape == (0, 5)


def test_shared_area_over_joint_area() -> None:
    one = torch.tensor([0.0, 0.0, 2.0, 2.0])
    others = torch.tensor([[0.0, 0.0, 2.0, 2.0], [1.0, 0.0, 2.0, 2.0], [5.0, 0.0, 2.0, 2.0], [0.0, 0.0, 1.0, 1.0]])
    assert iou(one, others).tolist() == pytest.approx([1.0, 1 / 3, 0.0, 0.25])


def test_of_boxes_about_one_ball_the_surest_stays_and_another_ball_is_kept() -> None:
    boxes = torch.tensor([
        [10.0, 10.0, 8.0, 8.0, 0.7], [11.0, 10.0, 8.0, 8.0, 0.9], [10.0, 11.0, 9.0, 9.0, 0.8],
        [60.0, 10.0, 8.0, 8.0, 0.6],
    ])  # fmt: skip
    assert keep_best(boxes, 0.3)[:, 4].tolist() == pytest.approx([0.9, 0.6])
    assert keep_best(boxes[:0], 0.3).shape == (0, 5)


def test_a_wild_head_gives_no_endless_box() -> None:
    heads = tuple(torch.full_like(head, 1e4) for head in silent_heads(64, 64))
    assert torch.isfinite(find_boxes((heads[0], heads[1]), 0.5, 0.3)[0]).all()
