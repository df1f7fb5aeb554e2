"""Where `detect` finds no ball: whether the settings for a ball without a rim find one."""

from __future__ import annotations

from app.cli.tabulate import Summary
from app.cli.terminal import say
from core.detection.saved import RIMLESS
from core.metrics.run import sample_rimless
from core.recordings import CameraStream


def rimless_summary(stream: CameraStream) -> Summary:
    """The share of a sample in which they find one, as `rimless`; empty if there is none."""
    sample = sample_rimless(stream)
    return {} if sample is None else {"rimless": round(sample.share, 4)}


def say_rimless(summary: Summary) -> None:
    """Print the file with the settings, if they find a ball."""
    share = summary.get("rimless")
    if isinstance(share, float):
        say(f"a ball without a rim? refined finds one in {share:.0%} of a sample with --config {RIMLESS}")
