import torch

from core.detection.yolo.network import YoloTiny


def test_it_has_the_layers_and_the_weights_of_the_published_one() -> None:
    network = YoloTiny()
    convolutions = [m for m in network.modules() if isinstance(m, torch.nn.Conv2d)]
    assert len(convolutions) == 21, "as in yolov4-tiny.cfg"
    weights = sum(parameter.numel() for parameter in network.parameters())
    assert weights == 5_874_116


def test_any_input_of_whole_cells_gives_boxes_for_each_cell() -> None:
    network = YoloTiny(width=0.125).eval()
    for height, width in ((64, 96), (384, 640)):
        coarse, fine = network(torch.zeros(2, 3, height, width))
        assert coarse.shape == (2, 18, height // 32, width // 32) and fine.shape == (2, 18, height // 16, width // 16)


def test_an_untrained_one_says_that_balls_are_rare() -> None:
    torch.manual_seed(0)
    coarse, fine = YoloTiny(width=0.125).eval()(torch.rand(1, 3, 64, 64))
    for head in (coarse, fine):
        assert torch.sigmoid(head.unflatten(1, (3, 6))[:, :, 4]).mean() < 0.05
