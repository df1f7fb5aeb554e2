"""Every method on flights, cameras and sensors drawn at random that no threshold was found with.

Each row of the table is one kind of difficulty. The standard sensor first, then one drawn anew for every flight: for
these the errors are given as they are and after one delay for each sensor, fitted on another flight that it saw.
Flights are scored one by one and the scores kept: an interrupted bench goes on where it was.

Scenes and sensors drawn at random, to measure detectors on what no threshold was found with.

A row names what is hard; a number draws everything else: the placement, the speed, spin and direction of the ball, and
where it is asked for the sensor, the brightness of ball and room. Development and scores draw from disjoint numbers.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np

from benchmarks.machine import describe_machine, machine_words
from core.cameras.presets import PLACEMENTS, stereo_preset
from core.detection.methods import Method, make_detector, method_config
from core.files import replace_file
from core.metrics.grid_score import SLOW_PX_PER_MS, GridScore, errors_without_lag, lag_ms, score_on_grid
from core.metrics.run import run_detector
from core.physics.config import Profile, physics_profile
from core.recordings import open_recording
from core.simulation import LaunchConfig, SceneConfig, SensorConfig, StereoConfig, scene_named, simulate_recording
from core.text import markdown_table, parse_json

Row = Literal["ball", "clutter", "crossing", "contrast", "slow"]
ROW_SCENES: Final[dict[Row, tuple[str, ...]]] = {
    "ball": ("ball",),
    "clutter": ("person", "head"),
    "crossing": ("two-persons", "rally"),
    "contrast": ("dark", "low-contrast"),
    "slow": ("ball",),
}
"""What each row of the table of goals is simulated with."""
NOISES_HZ: Final = (0.1, 1.0, 5.0)
SPEEDS_MPS: Final = (5.0, 9.0)
SLOW_MPS: Final = 3.0
SCORED_FROM: Final = 100_000
"""Numbers below are for development, from here on for scores: no threshold is found on them."""


@dataclass(frozen=True, slots=True)
class DrawnFlight:
    """One serve, or rally, to simulate."""

    row: Row
    number: int
    placement: str
    stereo: StereoConfig
    launch: LaunchConfig
    physics: Profile


def draw_flight(row: Row, number: int, *, any_sensor: bool) -> DrawnFlight:
    """The flight of a row and number; with `any_sensor` sensor and room are drawn too, else they are the standard ones.

    The same row and number fly the same ball past the same cameras, whatever the sensor.
    """
    rng = np.random.default_rng([number, *row.encode()])
    scene_name = str(rng.choice(ROW_SCENES[row]))
    names = [name for name in PLACEMENTS if scene_name != "rally" or name != "behind"]  # a player would stand before it
    placement = str(rng.choice(names))
    speed_mps = SLOW_MPS if row == "slow" else float(rng.uniform(*SPEEDS_MPS))
    noise_hz = float(rng.choice(NOISES_HZ)) if row == "ball" else NOISES_HZ[0]
    physics: Profile = "real" if rng.random() < 0.5 and scene_name != "rally" else "paper"  # whose balls have no air
    launch = LaunchConfig(
        speed_mps=speed_mps, yaw_spread_deg=2.0, spin_spread_radps=60.0 if physics_profile(physics).has_air else 0.0
    )
    scene, sensor = scene_named(scene_name), SensorConfig(noise_hz=noise_hz)
    if any_sensor:
        scene, sensor = draw_room(scene, rng), draw_sensor(rng)
    return DrawnFlight(row, number, placement, StereoConfig(scene=scene, sensor=sensor), launch, physics)


def draw_sensor(rng: np.random.Generator) -> SensorConfig:
    """A sensor of any make: thresholds, their mismatch, speed in good or bad light, noise, hot pixels."""
    threshold = float(np.exp(rng.uniform(np.log(0.1), np.log(0.4))))
    uneven = float(rng.uniform(-0.15, 0.15))
    return SensorConfig(
        on_threshold=threshold * (1.0 + uneven),
        off_threshold=threshold * (1.0 - uneven),
        threshold_mismatch=float(rng.uniform(0.03, 0.15)),
        refractory_us=int(np.exp(rng.uniform(0.0, np.log(200.0)))),
        photoreceptor_us=float(np.exp(rng.uniform(np.log(50.0), np.log(800.0)))),
        noise_hz=float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))),
        hot_pixels_per_million=float(rng.uniform(0.0, 250.0)),
    )


def draw_room(scene: SceneConfig, rng: np.random.Generator) -> SceneConfig:
    """The scene in other light, with another ball and other walls, about as hard for its contrast."""
    brighter = float(np.exp(rng.uniform(np.log(0.75), np.log(1.3))))

    def changed(reflectance: float) -> float:
        return float(np.clip(reflectance * brighter * np.exp(rng.uniform(-0.15, 0.15)), 0.02, 0.95))

    return replace(
        scene,
        ball=float(np.clip(scene.ball * np.exp(rng.uniform(-0.15, 0.1)), 0.02, 0.95)),
        table=changed(scene.table),
        floor=changed(scene.floor),
        wall=changed(scene.wall),
        ambient=float(rng.uniform(0.4, 0.8)),
        edge_px=float(rng.uniform(1.2, 2.4)),
    )


REPORT: Final = Path("docs/measured/drawn-scenes-report.md")
FOLDER: Final = Path("rallyscope-data/bench-drawn-scenes")
METHODS: Final[tuple[Method, ...]] = ("auto", "refined")
COUNT: Final = 20
"""Flights of each row and sensor."""
SLOWEST_PX_PER_MS: Final = 0.3
ANY_SPEED: Final = 1e9
WORDS: Final[dict[Row, str]] = {
    "ball": "ball only; noise of 0.1, 1 or 5 events a second and pixel",
    "clutter": "a person with a racket, or a head; the ball's shadow",
    "crossing": "two persons, the ball crosses bodies; a rally",
    "contrast": "a dark ball; a ball little brighter than the room",
    "slow": "serves of 3 m/s, while they move 0.3 to 2 px/ms",
}
TITLES: Final = (
    "row", "sensor", "method", "precision", "recall", "error median px", "p95", "median after delay", "p95 after delay",
    "asked", "false",
)  # fmt: skip
FORMATS: Final = ("", "", "", ".4f", ".3f", ".2f", ".2f", ".2f", ".2f", "d", "d")


def run(
    progress: Callable[[float], None], *, folder: Path = FOLDER, report: Path = REPORT, count: int = COUNT
) -> dict[str, object]:
    """A row per row, sensor and method, the report's place, and the machine."""
    cases = [(row, number, drawn) for row in get_args(Row) for drawn in (False, True) for number in range(count)]
    found: dict[tuple[Row, bool, str], list[dict[str, GridScore]]] = {}
    for done, (row, number, drawn) in enumerate(cases):
        flight = draw_flight(row, SCORED_FROM + number, any_sensor=drawn)
        for method, scores in score_flight(flight, drawn, folder).items():
            found.setdefault((row, drawn, method), []).append(scores)
        progress((done + 1) / len(cases))
    rows = [summarise(row, drawn, method, scores) for (row, drawn, method), scores in found.items()]
    machine = describe_machine("numba", "numpy", clock="none: counts and pixels")
    report.write_text(write_report(rows, count, machine), encoding="utf-8")
    return {"rows": rows, "flights": len(cases), "report": str(report), "machine": machine}


def score_flight(flight: DrawnFlight, drawn: bool, folder: Path) -> dict[str, dict[str, GridScore]]:
    """By method, the sum of both cameras: `scored`, and of a second flight before the same sensor, `fitted`."""
    kept = folder / f"{flight.row}-{flight.number}-{'drawn' if drawn else 'standard'}.json"
    if not kept.is_file():
        scores = {"scored": _simulate_and_score(flight)}
        if drawn:
            other = draw_flight("ball", flight.number + 1, any_sensor=False)
            there = replace(other, stereo=flight.stereo, placement=flight.placement, physics=flight.physics)
            scores["fitted"] = _simulate_and_score(there)
        by_method = {method: {name: asdict(one[method]) for name, one in scores.items()} for method in scores["scored"]}
        replace_file(kept, json.dumps(by_method, default=_plain).encode(), durable=False)
    stored = parse_json(kept.read_text(encoding="utf-8"))
    return {method: {name: _score_from(one) for name, one in names.items()} for method, names in stored.items()}


def _simulate_and_score(flight: DrawnFlight) -> dict[str, GridScore]:
    speeds = (SLOWEST_PX_PER_MS, SLOW_PX_PER_MS) if flight.row == "slow" else (SLOW_PX_PER_MS, ANY_SPEED)
    scores = {method: GridScore() for method in METHODS}
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as temporary:
        path = Path(temporary) / "flight.h5"
        cameras, physics = stereo_preset(flight.placement), physics_profile(flight.physics)
        simulate_recording(path, flight.stereo, cameras, [flight.launch], seed=flight.number, physics=physics)
        for stream in open_recording(path).cameras.values():
            assert stream.truth is not None
            for method in METHODS:
                window_us = method_config(method).window.window_us
                answers = run_detector(stream, make_detector(method, stream.sensor), window_us)
                scores[method] += score_on_grid(answers, stream.truth, stream.sensor, speeds, window_us=window_us)
    return scores


def summarise(row: Row, drawn: bool, method: str, flights: list[dict[str, GridScore]]) -> dict[str, object]:
    """One row of the table, over all its flights."""
    whole = sum((one["scored"] for one in flights), GridScore())
    corrected = [_after_delay(one["scored"], one["fitted"]) for one in flights if "fitted" in one]
    errors = np.concatenate(corrected) if corrected else np.empty(0)
    return {
        "row": row,
        "sensor": "drawn" if drawn else "standard",
        "method": method,
        "precision": whole.precision,
        "recall": whole.recall,
        "median_px": whole.error_at(50),
        "p95_px": whole.error_at(95),
        "median_after_delay_px": float(np.percentile(errors, 50)) if len(errors) else None,
        "p95_after_delay_px": float(np.percentile(errors, 95)) if len(errors) else None,
        "asked": whole.asked,
        "false": whole.false,
    }


def _after_delay(scored: GridScore, fitted: GridScore) -> np.ndarray:
    """The errors of a flight as they would be with the delay that another flight tells of the same sensor."""
    return errors_without_lag(scored, lag_ms(fitted)) if len(fitted.speed_px_per_ms) else scored.error_px


def _plain(value: object) -> list[float]:
    assert isinstance(value, np.ndarray)
    return [round(number, 4) for number in value.tolist()]


def _score_from(stored: dict[str, Any]) -> GridScore:
    errors = (np.array(stored[name]) for name in ("error_px", "along_px", "speed_px_per_ms"))
    return GridScore(stored["asked"], stored["found"], stored["answers"], stored["false"], *errors)


def write_report(rows: list[dict[str, object]], count: int, machine: dict[str, object]) -> str:
    """The report as Markdown."""
    lines = [
        "# Detectors on drawn scenes",
        "",
        "Made by `rallyscope bench drawn-scenes`. Every flight draws its placement, speed (5 to 9 m/s), direction,",
        f"spin and physics; {count} of each row and sensor, both 1280x720 cameras, from numbers that no threshold was",
        "found with. `drawn` sensors have thresholds of 0.1 to 0.4 (ON and OFF up to 30 % apart), a mismatch of 3 to",
        "15 %, a photoreceptor of 50 to 800 us, a refractory time of 1 to 200 us, 0.1 to 5 noise events a second and",
        "pixel, and hot pixels; their rooms another brightness, light and sharpness.",
        "",
        "Precision: every answer without the ball within 8 px at its own time is false. Recall: of the milliseconds at",
        "which the whole disc is in view and has been for 10 ms, those with an answer within half a window; rows count",
        "balls above 2 px/ms, `slow` those of 0.3 to 2 px/ms. Errors are at the time the answer states; `after delay`",
        "corrects them by one number for each sensor, fitted on another flight before it.",
        "",
        markdown_table(TITLES, [list(row.values()) for row in rows], FORMATS),
        *[f"- **{name}**: {words}." for name, words in WORDS.items()],
        "",
        f"Made on {machine_words(machine)}.",
        "",
    ]
    return "\n".join(lines)
