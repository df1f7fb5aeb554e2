"""The network needs torch, which takes a second to load: nobody loads it who does not look at pictures."""

import subprocess
import sys

import pytest

from tests.waiting import PATIENCE_S


@pytest.mark.parametrize(
    "modules",
    [
        "core.detection, core.detection.methods, core.metrics.run, core.recordings, core.tuning",
        "app.cli.detect, app.cli.train_detector, app.cli.track, app.cli.bench",
        "core.detection.yolo, core.detection.yolo.config, core.detection.yolo.letterbox",
    ],
)
def test_nothing_that_does_not_use_the_network_loads_it(modules: str) -> None:
    code = f"import {modules}, sys; print(*sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    loaded = set(ended.stdout.split())
    assert not {"torch", "core.detection.yolo.network", "benchmarks.detector_training.training"} & loaded
