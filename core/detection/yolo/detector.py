"""YOLOv4-tiny as a detector: the most confident box of a window's picture is the ball."""

from __future__ import annotations

from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.yolo.boxes import find_boxes
from core.detection.yolo.config import YoloConfig
from core.detection.yolo.letterbox import letterbox
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import YoloWeights
from core.events import Window

WHITE: Final = 255.0


class YoloDetector:
    """Detects in the picture of a window, not in its events; a window without a picture has no ball.

    An answer is valid in the middle of the exposure. The radius is half the side of the square of the box's area.
    Nothing is remembered from one picture to the next.
    """

    def __init__(self, weights: YoloWeights, device: str = "cpu") -> None:
        self.config = weights.config
        self._network = weights.network.to(device)
        self._device = device
        self.reset()

    def reset(self) -> None:
        """Do nothing: it has no state."""
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball in the middle of the picture's exposure, or None."""
        self.extra_circles = 0
        if window.frame is None:
            return None
        circles = find_circles(self._network, self.config, window.frame.image, self._device)
        if not len(circles):
            return None
        self.extra_circles = len(circles) - 1
        u, v, r = (float(value) for value in circles[0, :3])
        return Detection(window.frame.t_us, u, v, r)


def find_circles(
    network: YoloTiny, config: YoloConfig, image: NDArray[np.uint8], device: str = "cpu"
) -> NDArray[np.float64]:
    """(N, 4): centre, radius in pixels of the picture and confidence, the most confident first.

    Raises:
        RecordingError: if it is no picture.
    """
    whole, place = letterbox(image, config.input_width_px, config.input_height_px)
    with torch.inference_mode():
        pixels = torch.from_numpy(whole).to(device).permute(2, 0, 1)[None]
        levels = pixels.to(dtype=torch.float32, memory_format=torch.channels_last) / WHITE
        boxes = find_boxes(network(levels), config.confidence, config.overlap)[0].double().cpu().numpy()
    found = []
    for x, y, width, height, sure in boxes.tolist():
        u, v, r = place.to_picture(x, y, (width * height) ** 0.5 / 2)
        if 0 <= u <= image.shape[1] - 1 and 0 <= v <= image.shape[0] - 1:
            found.append((u, v, r, sure))
    return np.array(found, np.float64).reshape(-1, 4)
