"""YOLOv4-tiny as published: a small CSP backbone, 32 times smaller at its end, and two heads of boxes.

Wang, Bochkovskiy and Liao 2021 (arXiv 2011.08036), with the layers of the authors' `yolov4-tiny.cfg`: 5.9 million
weights for one class. The size of the input is none of its layers' business.
"""

from __future__ import annotations

import math
from typing import Final

import torch
from torch import Tensor, nn

from core.detection.yolo.boxes import ANCHORS_PX, FIELDS

LEAK: Final = 0.1
"""Slope of the activation below zero."""
RARE: Final = 0.01
"""Initial objectness of every box: most have no ball."""
OBJECT: Final = 4
"""Index of the objectness in a box's fields."""


class ConvBlock(nn.Sequential):
    """A convolution, its batch normalised, and the leaky activation."""

    def __init__(self, channels_in: int, channels_out: int, kernel: int, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(channels_in, channels_out, kernel, stride, kernel // 2, bias=False),
            nn.BatchNorm2d(channels_out),
            nn.LeakyReLU(LEAK),
        )


class CspBlock(nn.Module):
    """Half of the channels go through two convolutions more; everything is put side by side again."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        self.first = ConvBlock(channels, channels, 3)
        self.second = ConvBlock(half, half, 3)
        self.third = ConvBlock(half, half, 3)
        self.joined = ConvBlock(2 * half, channels, 1)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 2 C, h, w), and the part (B, C, h, w) of it that the finer head looks at."""
        whole = self.first(x)
        second = self.second(whole.chunk(2, dim=1)[1])
        joined = self.joined(torch.cat([self.third(second), second], dim=1))
        return torch.cat([whole, joined], dim=1), joined


class YoloTiny(nn.Module):
    """Pictures (B, 3, H, W) of 0..1 to the raw boxes of two heads, H and W multiples of 32."""

    def __init__(self, width: float = 1.0) -> None:
        super().__init__()
        c32, c64, c128, c256, c512 = (_channels(count, width) for count in (32, 64, 128, 256, 512))
        self.stem = nn.Sequential(ConvBlock(3, c32, 3, 2), ConvBlock(c32, c64, 3, 2))
        self.csp1, self.csp2, self.csp3 = CspBlock(c64), CspBlock(2 * c64), CspBlock(4 * c64)
        self.pool = nn.MaxPool2d(2)
        self.neck = nn.Sequential(ConvBlock(8 * c64, c512, 3), ConvBlock(c512, c256, 1))
        self.coarse = nn.Sequential(ConvBlock(c256, c512, 3), _head(c512, 0))
        self.up = nn.Sequential(ConvBlock(c256, c128, 1), nn.Upsample(scale_factor=2))
        self.fine = nn.Sequential(ConvBlock(c128 + 4 * c64, c256, 3), _head(c256, 1))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(B, A F, H/32, W/32) and (B, A F, H/16, W/16): A anchors with F fields each, as `boxes` reads them."""
        x = self.pool(self.csp1(self.stem(x))[0])
        x = self.pool(self.csp2(x)[0])
        x, part = self.csp3(x)
        x = self.neck(self.pool(x))
        return self.coarse(x), self.fine(torch.cat([self.up(x), part], dim=1))


def _channels(published: int, width: float) -> int:
    return max(4, 2 * round(published * width / 2))


def _head(channels: int, scale: int) -> nn.Conv2d:
    """One convolution; its bias says at first that balls are rare."""
    head = nn.Conv2d(channels, len(ANCHORS_PX[scale]) * FIELDS, 1)
    assert head.bias is not None
    with torch.no_grad():
        head.bias.zero_()
        head.bias[OBJECT::FIELDS] = math.log(RARE / (1 - RARE))
    return head
