"""Every scene: how hard it is for the detector, how many balls come back, and what it looks like."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.detection.simulated_streams import simulate_flights
from benchmarks.machine import describe_machine, machine_words
from benchmarks.partial_rows import report_rows_to
from benchmarks.simulation.scene_picture import picture_of_scene
from core.cameras import stereo_preset
from core.detection import make_detector
from core.live.worlds.closed_loop import ClosedLoop
from core.live.worlds.world import WorldConfig
from core.metrics.run import duration_of
from core.metrics.score import score_recording
from core.simulation import StereoConfig, scene_named
from core.simulation.scenes.scene import SCENES
from core.text.markdown_table import markdown_table

REPORT: Final = Path("docs/measured/scenes.md")
PICTURES: Final = Path("docs/measured/images")
METHODS: Final = ("auto", "paper")
PLACEMENTS: Final = ("side", "behind")
OF_RALLY: Final = ("side", "ceiling")
"""A player would stand before the cameras behind the robot's end."""
SPEEDS_MPS: Final = (5.0, 7.0)
WINDOW_US: Final = 2000
NOISE_HZ: Final = 0.1
SEED: Final = 31
BALLS: Final = 10
"""Played through perception in every scene, at 5 m/s."""
WORDS: Final = {
    "ball": "a bright ball in a dark room, nobody there",
    "dark": "a dark ball in a bright room",
    "low-contrast": "a ball 1.8 times as bright as the table",
    "person": "a player at the far end who practises strokes",
    "two-persons": "that player, and somebody who walks to and fro beside the table",
    "rally": "two players; in a recording they play the ball, live they practise",
    "head": "a bright round thing of a head's size that floats over the table, at times before the ball",
}


TITLES: Final = (
    "scene", "cameras", "Mev/s", "windows with ball", "method", "precision", "recall", "median error px", "returned"
)  # fmt: skip
FORMATS: Final = ("", "", ".2f", "d", "", ".3f", ".3f", ".2f")
Row = dict[str, object]


def run(
    progress: Callable[[float], None],
    *,
    report: Path = REPORT,
    pictures: Path = PICTURES,
    scenes: tuple[str, ...] = tuple(SCENES),
    balls: int = BALLS,
) -> dict[str, object]:
    """A row per scene, placement and method, the balls that came back, and the machine."""
    seen: list[Row] = []
    returned: dict[str, int] = {}
    steps = len(scenes) * (len(PLACEMENTS) + 1)
    for number, scene in enumerate(scenes):
        for index, placement in enumerate(OF_RALLY if scene == "rally" else PLACEMENTS):
            found = detect_in(scene, placement)
            seen += found
            report_rows_to(progress, found, (number * (len(PLACEMENTS) + 1) + index + 1) / steps)
        returned[scene] = play_in(scene, balls)
        progress((number + 1) * (len(PLACEMENTS) + 1) / steps)
    machine = describe_machine("numba", "numpy", clock="none: counts of simulated windows and balls")
    for scene in scenes:
        picture_of_scene(scene, pictures / f"scene-{scene}.jpg", seed=SEED)
    report.write_text(write_scenes_report(seen, returned, balls, machine), encoding="utf-8")
    return {"rows": seen, "returned": returned, "balls": balls, "report": str(report), "machine": machine}


def detect_in(scene: str, placement: str) -> list[Row]:
    """A row for every method on both cameras, window after window with its region of interest."""
    streams = simulate_flights(scene, NOISE_HZ, SPEEDS_MPS, seed=SEED, placement=placement)
    mevps = sum(stream.event_count for stream in streams) / duration_of(streams[0])
    rows: list[Row] = []
    for method in METHODS:
        scores = [
            score_recording(stream, make_detector(method, stream.sensor), window_us=WINDOW_US) for stream in streams
        ]
        found, false = sum(score.found for score in scores), sum(score.false for score in scores)
        with_ball = sum(score.with_ball for score in scores)
        error_px = float(np.nanmean([score.median_error_px for score in scores]))
        precision = found / (found + false) if found + false else float("nan")
        rows.append(
            {
                "scene": scene,
                "placement": placement,
                "mevps": mevps,  # of both cameras, millions per second
                "windows_with_ball": with_ball,
                "method": method,
                "precision": precision,
                "recall": found / with_ball,
                "median_error_px": error_px,
            }
        )
    return rows


def play_in(scene: str, balls: int) -> int:
    """How many balls of 5 m/s the built-in controller returns through perception, cameras at the side."""
    world = WorldConfig(stereo=StereoConfig(scene=scene_named(scene)))
    loop = ClosedLoop(world, stereo_preset(), seed=SEED, told=True)
    try:
        return sum(loop.play(5.0).returned for _ in range(balls))
    finally:
        loop.close()


def write_scenes_report(seen: list[Row], returned: dict[str, int], balls: int, machine: dict[str, object]) -> str:
    """The report as Markdown."""
    speeds = " and ".join(f"{speed:g}" for speed in SPEEDS_MPS)
    lines = [
        "# Scenes",
        "",
        "Made by `rallyscope bench scenes`. A scene is chosen with `--scene` (`simulate`, `sim-server`) and in Watch;",
        "`--wall 0.7` makes the walls bright, `--flicker 0.2` lets all light flicker. How people are drawn, and how",
        "well that agrees with brute force: [sensor-model.md](../how/sensor-model.md),",
        "[sensor-report.md](sensor-report.md).",
        "",
        f"Two 1280x720 cameras, {NOISE_HZ} Hz of noise per pixel, serves (or rallies) of {speeds} m/s, windows of",
        f"{WINDOW_US // 1000} ms, default settings of the methods, match radius 8 px; a ball hidden by a person is no",
        "ball to find. Returned: balls of 5 m/s that the built-in controller returns through the chain, cameras at the",
        f"side. Seed {SEED}.",
        "",
    ]
    back = {scene: f"{count} of {balls}" for scene, count in returned.items()}
    rows = [
        [*row.values(), back[str(row["scene"])] if (row["placement"], row["method"]) == ("side", "auto") else ""]
        for row in seen
    ]
    lines += [markdown_table(TITLES, rows, FORMATS), f"Made on {machine_words(machine)}.", ""]
    for scene in returned:
        lines += [f"## {scene}", f"{WORDS[scene].capitalize()}.", "", f"![{scene}](images/scene-{scene}.jpg)", ""]
    return "\n".join(lines)
