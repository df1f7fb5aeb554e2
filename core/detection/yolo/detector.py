"""YOLOv4-tiny as a detector: the most confident box of a window's picture is the ball."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.method_trace import (
    RAW,
    RESULT,
    CandidateRow,
    MethodTrace,
    Outline,
    StageCount,
    View,
    circle_points,
)
from core.detection.reasons import Reason
from core.detection.yolo.boxes import find_boxes
from core.detection.yolo.config import YoloConfig
from core.detection.yolo.letterbox import letterbox
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import YoloWeights
from core.events import Window

WHITE: Final = 255.0
WEAK: Final = 0.1
"""Share of the confidence needed from which a box is listed in a trace."""


@dataclass(frozen=True, slots=True, eq=False)
class YoloTrace:
    """The boxes of one picture."""

    boxes: NDArray[np.float64]
    """(N, 4) centre, radius in pixels of the picture and confidence, the most confident first; also those with too
    little."""
    confidence_needed: float
    detection: Detection | None
    seconds: float


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
        self._image: NDArray[np.uint8] | None = None

    def step(self, window: Window) -> Detection | None:
        """The ball in the middle of the picture's exposure, or None."""
        self.extra_circles = 0
        self._image = None if window.frame is None else window.frame.image
        if window.frame is None:
            return None
        circles = find_circles(self._network, self.config, window.frame.image, self._device)
        if not len(circles):
            return None
        self.extra_circles = len(circles) - 1
        u, v, r = (float(value) for value in circles[0, :3])
        return Detection(window.frame.t_us, u, v, r)

    def why_not(self) -> tuple[Reason, ...]:
        """Why the last picture had no ball: too little confidence of the best box. It takes as long as a step."""
        return _reasons(self._boxes(), self.config, has_picture=self._image is not None)

    def trace(self, window: Window) -> YoloTrace:
        """The step of this window with every box."""
        start_s = time.perf_counter()
        detection = self.step(window)
        seconds = time.perf_counter() - start_s
        return YoloTrace(self._boxes(), self.config.confidence, detection, seconds)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window as `detect --explain` prints it."""
        trace = self.trace(window)
        return _view_of(trace, _reasons(trace.boxes, self.config, has_picture=window.frame is not None))

    def _boxes(self) -> NDArray[np.float64]:
        """(N, 4) boxes of the last picture, those with too little confidence among them."""
        if self._image is None:
            return np.empty((0, 4))
        loose = dataclasses.replace(self.config, confidence=max(0.01, WEAK * self.config.confidence))
        return find_circles(self._network, loose, self._image, self._device)


def _reasons(boxes: NDArray[np.float64], config: YoloConfig, *, has_picture: bool) -> tuple[Reason, ...]:
    """The confidence of the best box, which is too low, or why there is none. The setting is part of the weights."""
    if not has_picture:
        return (Reason("pictures in the window", None, 0, 1),)
    if not len(boxes):
        sentence = f"no box has {WEAK:.0%} of the confidence {config.confidence:g}"
        return (Reason("confidence of the best box", None, None, config.confidence, sentence=sentence),)
    return (Reason("confidence of the best box", None, float(boxes[0, 3]), config.confidence),)


def _view_of(trace: YoloTrace, reasons: tuple[Reason, ...]) -> MethodTrace:
    shapes, rows = [], []
    for number, (u, v, r, sure) in enumerate(trace.boxes.tolist()):
        enough = sure >= trace.confidence_needed
        corner = (u + r + 2, v - r)
        shapes.append(Outline("accepted" if enough else "rejected", circle_points(u, v), r, f"{sure:.2f}", corner))
        why = () if enough else (Reason("confidence", None, sure, trace.confidence_needed),)
        state = "ball" if number == 0 else "another box"
        places = np.array([u]), np.array([v])
        rows.append(CandidateRow(number, (f"{u:.1f}, {v:.1f}", f"{r:.1f}", f"{sure:.2f}"), why, state, sure, *places))
    return MethodTrace(
        views=(View(RAW, "", None), View("boxes", "", None, tuple(shapes)), View(RESULT, "", None)),
        counts={
            "yolo": StageCount(len(rows), sum(not row.reasons for row in rows), unit="boxes", seconds=trace.seconds)
        },
        noun="box",
        titles=("centre [px]", "radius [px]", "confidence"),
        candidates=tuple(rows),
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons,
        where="searched in the whole picture",
    )


def find_circles(
    network: YoloTiny, config: YoloConfig, image: NDArray[np.uint8], device: str = "cpu"
) -> NDArray[np.float64]:
    """(N, 4): centre, radius in pixels of the picture and confidence, the most confident first.

    Args:
        network: with its weights.
        config: size of its input, confidence, overlap.
        image: (H, W, 3) or (H, W), 0 to 255.
        device: where the network is.

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
