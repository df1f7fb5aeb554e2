"""Layout of an exported recording in the Rerun viewer, and its curves: event rates, latencies, errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from app.export.rrd.paths import EPISODE, LANDINGS, PLOTS, TIMELINE, TRAIL, WORLD, known, picture_path, send_scalars
from app.export.selection import Span
from app.export.steps import ChainStep
from core.chain.follow import true_positions
from core.events import rate_curve
from core.recordings import Recording
from core.recordings.layout import Rows

RATE_BIN_MS = 5
REWARD = f"{PLOTS}/reward"
COLOURS = ((255, 150, 50), (80, 150, 255), (110, 235, 130), (255, 90, 220))
RATES, LATENCY, ERROR_PX, ERROR_MM = (f"{PLOTS}/{name}" for name in ("event_rate", "latency", "error_px", "error_mm"))


def log_styles(stream: rr.RecordingStream, cameras: Sequence[str]) -> None:
    """Names and colours; units are in the titles of the views."""
    curves = {f"{RATES}/{name}": name for name in cameras}
    curves |= {f"{ERROR_PX}/{name}": name for name in cameras}
    curves |= {f"{ERROR_PX}/residual": "rays", f"{ERROR_MM}/ball": "ball"}
    curves |= {f"{LATENCY}/{name}": name for name in ("detect", "triangulate", "predict")}
    stream.log(REWARD, rr.SeriesPoints(colors=[COLOURS[0]], names=["reward of an episode"]), static=True)
    numbers: dict[str, int] = {}
    for path, name in curves.items():
        plot = path.rsplit("/", 1)[0]
        numbers[plot] = numbers.get(plot, -1) + 1
        style = rr.SeriesLines(colors=[COLOURS[numbers[plot] % len(COLOURS)]], names=[name], widths=[1.5])
        stream.log(path, style, static=True)


def send_rates(stream: rr.RecordingStream, recording: Recording, span: Span) -> None:
    """Events per millisecond of every camera, from the index."""
    first, last = span.start_us // 1000, -(-span.end_us // 1000)
    length_us = min(1000 * last, recording.duration_us) - 1000 * first
    for name, camera in recording.cameras.items():
        counts = camera.counts_per_ms()[first:last]
        curve = rate_curve(counts, length_us, bins=-(-len(counts) // RATE_BIN_MS))
        send_scalars(stream, f"{RATES}/{name}", 1000 * first + 1e6 * curve.t_s, curve.rate_hz / 1e3)


def send_step_curves(stream: rr.RecordingStream, recording: Recording, steps: Sequence[ChainStep]) -> None:
    """Latencies of the stages, and errors where the truth is known, a value per window."""
    times = [step.end_us for step in steps]
    send_scalars(stream, f"{LATENCY}/detect", times, [1e3 * step.detect_s for step in steps])
    chains = [step.chain for step in steps if step.chain is not None]
    if chains:
        for name in ("triangulate", "predict"):
            values = [1e3 * float(getattr(chain.seconds, name)) for chain in chains]
            send_scalars(stream, f"{LATENCY}/{name}", times, values)
        points = [chain.point for chain in chains]
        residuals = [np.nan if point is None else point.residual_px for point in points]
        send_scalars(stream, f"{ERROR_PX}/residual", times, residuals)
        if recording.ball is not None:
            nowhere = np.full(3, np.nan)
            found = np.array([nowhere if point is None else point.p_world_m for point in points])
            when = [end if point is None else point.t_us for end, point in zip(times, points, strict=True)]
            errors = 1e3 * np.linalg.norm(found - true_positions(recording.ball, when), axis=1)
            send_scalars(stream, f"{ERROR_MM}/ball", times, errors)
    for name in recording.cameras:
        t_us, errors = pixel_errors(recording, name, steps)
        send_scalars(stream, f"{ERROR_PX}/{name}", t_us, errors)


def send_rewards(stream: rr.RecordingStream, rows: Rows) -> None:
    """The reward of each episode, at its serve."""
    send_scalars(stream, REWARD, rows["serve_us"], rows["reward"])


def pixel_errors(
    recording: Recording, camera: str, steps: Sequence[ChainStep]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times and distances of the detections from the truth; nan where there is none, or no ball is visible."""
    truth = recording.cameras[camera].truth
    if truth is None:
        return np.empty(0, np.int64), np.empty(0)
    found = [step.detections[camera] for step in steps]
    t_us = np.array([step.end_us if one is None else one.t_us for step, one in zip(steps, found, strict=True)])
    centres = np.array([(np.nan, np.nan) if one is None else (one.u_px, one.v_px) for one in found]).reshape(-1, 2)
    now = truth.at(t_us)
    return t_us, np.hypot(centres[:, 0] - now.u_px, centres[:, 1] - now.v_px)


TRAIL_S = 0.4
PLOT_BEFORE_S = 1.0
RECENT_EPISODES = 100
BACKGROUND = (22, 24, 29)
_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
_NO_LEGEND = rrb.PlotLegend(visible=False)


def recording_blueprint(cameras: Mapping[str, bool], *, rewards: bool) -> rrb.Blueprint:
    """3D on the left, the pictures on the right, curves below. `cameras`: whether each is calibrated."""
    calibrated = any(cameras.values())
    pictures = [
        rrb.Spatial2DView(origin=picture_path(name, calibrated=ok), name=name, background=BACKGROUND)
        for name, ok in cameras.items()
    ]
    plots = [
        _plot(RATES, "Events per ms"),
        _plot(LATENCY, "Latency, ms"),
        _plot(ERROR_PX, "Errors in the pictures, px"),
    ]
    if calibrated:
        plots.append(_plot(ERROR_MM, "Ball to truth, mm", legend=False))
        if rewards:
            plots.append(rrb.TimeSeriesView(origin=REWARD, name="Reward of each ball", plot_legend=_NO_LEGEND))
        top = rrb.Horizontal(_world(), rrb.Vertical(*pictures), column_shares=[3, 2])
    else:
        top = rrb.Horizontal(*pictures)
    return rrb.Blueprint(
        rrb.Vertical(top, rrb.Horizontal(*plots), row_shares=[7, 2]),
        known(rrb.TimePanel, state="collapsed", timeline=TIMELINE, playback_speed=0.1, play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def run_blueprint(seeds: Sequence[str], curves: Mapping[str, str]) -> rrb.Blueprint:
    """Layout of a run: landing points in 3D, one view per seed, and curves. `curves`: entity -> title."""
    spots = [_landings(f"{WORLD}/{seed}", seed) for seed in seeds]
    plots = [rrb.TimeSeriesView(origin=path, name=name, plot_legend=_LEGEND) for path, name in curves.items()]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Grid(*spots), rrb.Grid(*plots, grid_columns=2), column_shares=[1, 1]),
        known(rrb.TimePanel, state="collapsed", timeline=EPISODE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def eye() -> rrb.EyeControls3D:
    """From the opponent's right: the whole table, the robot's end on the left."""
    return known(rrb.EyeControls3D, position=(1.5, -3.0, 1.55), look_target=(-0.25, 0.0, 0.0), eye_up=(0, 0, 1))


def _world() -> rrb.Spatial3DView:
    trail = _window(TIMELINE, -TRAIL_S)
    landed = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    return rrb.Spatial3DView(
        origin=WORLD,
        name="Rally",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=eye(),
        overrides={TRAIL: trail, LANDINGS: landed},
    )


def _landings(origin: str, name: str) -> rrb.Spatial3DView:
    recent = rrb.VisibleTimeRanges(
        timeline=EPISODE,
        start=rrb.TimeRangeBoundary.cursor_relative(seq=-RECENT_EPISODES),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=WORLD,
        name=f"The last {RECENT_EPISODES} landings, {name}",
        contents=[f"+ /{WORLD}", f"+ /{WORLD}/table/**", f"+ /{WORLD}/net/**", f"+ /{origin}/**"],
        background=BACKGROUND,
        line_grid=False,
        eye_controls=known(
            rrb.EyeControls3D, position=(-0.4, -2.6, 2.6), look_target=(0.3, 0.0, 0.0), eye_up=(0, 0, 1)
        ),
        overrides={f"{origin}/landing": recent},
    )


def _plot(path: str, name: str, *, legend: bool = True) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=path,
        name=name,
        plot_legend=_LEGEND if legend else _NO_LEGEND,
        time_ranges=_window(TIMELINE, -PLOT_BEFORE_S, PLOT_BEFORE_S),
    )


def _window(timeline: str, start_s: float, end_s: float = 0.0) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(
        timeline=timeline,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=start_s),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=end_s),
    )
