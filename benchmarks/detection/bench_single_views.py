"""`refined` on each single view of a flight: how soon a ball is found, how often it is missed, how long it is wrong.

Pooled figures hide a view that fails. Each row is a kind of scene before several placements of cameras; every camera is
a view of its own, and the worst one of them is named. The sensor is the standard one, with default settings.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, machine_words, report_rows_to
from core.cameras.presets import PRESETS, camera_preset
from core.detection.methods import make_detector, method_config
from core.events import Events
from core.files import replace_file
from core.metrics.grid_score import GridScore, score_on_grid
from core.metrics.run import WindowAnswers, duration_of, run_detector
from core.metrics.score import MATCH_RADIUS_PX
from core.physics.config import Profile, physics_profile
from core.recordings import CameraStream, PixelTruth, open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording
from core.text import markdown_table

REPORT: Final = Path("docs/measured/single-views-report.md")
SEEDS: Final = (511, 512)
SPEED_MPS: Final = 5.0
NOISE_HZ: Final = 0.1
METHOD: Final = "refined"
ROWS: Final[dict[str, tuple[str, ...]]] = {
    "ball": PRESETS,
    "person": ("side", "behind"),
    "two-persons": ("side", "behind"),
    "rally": ("side",),
    "dark": ("side", "behind", "ceiling"),
    "low-contrast": ("side", "behind", "ceiling"),
}
"""Scene of each row and the placements of the cameras that look at it."""
FIRST_EVENTS: Final = 12
FIRST_WITHIN_US: Final = 3000
RIM_PX: Final = 2.5
"""A ball has been seen once so many events lay so near to its true rim in so short a time."""
SENSOR_DELAY_US: Final = 230
"""Of the standard sensor: an event is compared with the rim as it was then."""
LEAST: Final = {"recall": 0.95, "precision": 0.99}
"""Of each view: what is aimed at."""
TITLES: Final = (
    "scene", "views", "recall", "worst view", "views below 0.95", "precision", "worst view", "views below 0.99",
    "longest run of false answers", "first answer median ms", "p90", "error median px", "p95",
)  # fmt: skip
FORMATS: Final = ("", "d", ".4f", ".3f", "d", ".4f", ".3f", "d", "d", ".1f", ".1f", ".2f", ".2f")
ANY_SPEED: Final = (0.0, 1e9)


@dataclass(frozen=True, slots=True, eq=False)
class ViewScore:
    """One camera of a flight."""

    grid: GridScore
    longest_false: int
    """Most false answers one after the other, without a right one between them."""
    first_ms: float | None
    """From the first events of the ball to the end of the first window with a right answer: inf if there is none, None
    if the ball made no events."""


def run(progress: Callable[[float], None], *, seeds: Sequence[int] = SEEDS, report: Path = REPORT) -> dict[str, object]:
    """A row per scene, the report's place, and the machine."""
    cases = [(scene, placement, seed) for scene, names in ROWS.items() for placement in names for seed in seeds]
    found: dict[str, list[ViewScore]] = {scene: [] for scene in ROWS}
    rows: list[dict[str, object]] = []
    for done, (scene, placement, seed) in enumerate(cases, start=1):
        found[scene] += score_views(scene, placement, seed)
        whole = done == len(cases) or cases[done][0] != scene
        rows += [summarise_views(scene, found[scene])] if whole else []
        report_rows_to(progress, rows[-1:] if whole else [], done / len(cases))
    machine = describe_machine("numba", "numpy", clock="none: counts and pixels")
    replace_file(report, write_report(rows, seeds, machine).encode(), durable=False)
    return {"rows": rows, "report": str(report), "machine": machine}


def score_views(scene: str, placement: str, seed: int) -> list[ViewScore]:
    """A score per camera of one serve, or rally; odd seeds fly with air and spin where nobody plays it back."""
    profile: Profile = "real" if seed % 2 and scene != "rally" else "paper"
    physics = physics_profile(profile)
    launch = LaunchConfig(speed_mps=SPEED_MPS, yaw_spread_deg=2.0, spin_spread_radps=60.0 if physics.has_air else 0.0)
    stereo = StereoConfig(scene=scene_named(scene), sensor=SensorConfig(noise_hz=NOISE_HZ))
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
        path = Path(folder) / "flight.h5"
        simulate_recording(path, stereo, camera_preset(placement), [launch], seed=seed, physics=physics, threads=1)
        with open_recording(path) as recording:
            return [score_view(stream) for stream in recording.cameras.values()]


def score_view(stream: CameraStream) -> ViewScore:
    """Every window of a camera against the truth."""
    truth = stream.truth
    assert truth is not None, "simulated recordings know where the ball is"
    window_us = method_config(METHOD).window.window_us
    answers = run_detector(stream, make_detector(METHOD, stream.sensor), window_us)
    right = right_answers(answers, truth)
    known = answers.detected & (answers.t_us >= truth.t_us[0]) & (answers.t_us <= truth.t_us[-1])
    seen_us = first_events_us(stream.slice(0, duration_of(stream)), truth)
    ends = answers.end_us[right & (answers.end_us >= (seen_us or 0))]
    first_ms = None if seen_us is None else float(ends[0] - seen_us) / 1000 if len(ends) else np.inf
    grid = score_on_grid(answers, truth, stream.sensor, ANY_SPEED, window_us=window_us)
    return ViewScore(grid, longest_run(~right[known]), first_ms)


def right_answers(answers: WindowAnswers, truth: PixelTruth) -> NDArray[np.bool_]:
    """(N,) windows whose answer is the ball, at its own time."""
    at = truth.at(answers.t_us)
    off_px = np.hypot(answers.u_px - at.u_px, answers.v_px - at.v_px)
    within = (answers.t_us >= truth.t_us[0]) & (answers.t_us <= truth.t_us[-1])
    return answers.detected & within & at.visible & (np.nan_to_num(off_px, nan=np.inf) <= MATCH_RADIUS_PX)


def longest_run(flags: NDArray[np.bool_]) -> int:
    """Most true values in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def first_events_us(events: Events, truth: PixelTruth) -> int | None:
    """Time at which the ball has made its first events, see `FIRST_EVENTS`; None if it never does."""
    at = truth.at(np.maximum(events.t_us - SENSOR_DELAY_US, truth.t_us[0]))
    off_px = np.abs(np.hypot(events.x_px - at.u_px, events.y_px - at.v_px) - at.r_px)
    t_us = events.t_us[at.visible & (np.nan_to_num(off_px, nan=np.inf) <= RIM_PX)]
    last_us = t_us[FIRST_EVENTS - 1 :]
    soon = last_us - t_us[: len(last_us)] <= FIRST_WITHIN_US
    return int(last_us[soon][0]) if soon.any() else None


def summarise_views(scene: str, views: Sequence[ViewScore]) -> dict[str, object]:
    """One row of the table; views in which no ball was to be found have no recall of their own."""
    whole = sum((one.grid for one in views), GridScore())
    row: dict[str, object] = {"scene": scene, "views": len(views)}
    for name, least in LEAST.items():
        each = np.array([getattr(one.grid, name) for one in views])
        worst = float(np.nanmin(each)) if np.isfinite(each).any() else float("nan")
        row |= {name: getattr(whole, name), f"worst_{name}": worst, f"below_{name}": int((each < least).sum())}
    firsts = np.array([one.first_ms for one in views if one.first_ms is not None])
    # a view without an answer has waited for ever: a rank of the sample, as between two values inf would be nan
    median, p90 = np.percentile(firsts, (50, 90), method="higher") if len(firsts) else (np.nan, np.nan)
    row |= {"longest_false": max(one.longest_false for one in views), "first_ms": float(median), "p90_ms": float(p90)}
    return row | {"median_px": whole.error_at(50), "p95_px": whole.error_at(95)}


PAGE: Final = """# Every single view of a ball

Made by `rallyscope bench single-views --seeds {seeds}`: `refined` with default settings. A serve (or a rally) of
{speed:g} m/s for each seed before each placement of 1280x720 cameras: the standard sensor, {noise:g} noise events a
second and pixel. Odd seeds fly with air and spin; even ones and rallies do not. No threshold was found with these
seeds. Each camera is a view.

Precision: every answer without the ball within 8 px at its own time is false. Recall: of the milliseconds at which the
whole disc is in view and has been for 10 ms, those with a right answer within half a millisecond. The columns beside
them: the worst view, and how many views miss 0.95 and 0.99. First answer: from the first {events} events within
{rim:g} px of the true rim in {within} ms to the end of the window with the first right answer. Aims: every view
above 0.95 and 0.99, at most 20 false answers in a row, 8 ms (median) for `ball`, 1 px at p95 for `low-contrast`.

{table}
{cameras}

Made on {machine}.
"""


def write_report(rows: Sequence[dict[str, object]], seeds: Sequence[int], machine: dict[str, object]) -> str:
    """The report as Markdown."""
    return PAGE.format(
        seeds=",".join(map(str, seeds)),
        speed=SPEED_MPS,
        noise=NOISE_HZ,
        events=FIRST_EVENTS,
        rim=RIM_PX,
        within=FIRST_WITHIN_US // 1000,
        table=markdown_table(TITLES, [list(row.values()) for row in rows], FORMATS),
        cameras="\n".join(f"- **{scene}**: cameras {', '.join(names)}." for scene, names in ROWS.items()),
        machine=machine_words(machine),
    )
