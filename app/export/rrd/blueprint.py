"""Layout of an exported recording in the Rerun viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb

from app.export.rrd.paths import EPISODE, LANDINGS, TIMELINE, TRAIL, WORLD, picture_path
from app.export.rrd.plots import ERROR_MM, ERROR_PX, LATENCY, RATES, REWARD

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
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, playback_speed=0.1, play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def run_blueprint(seeds: Sequence[str], curves: Mapping[str, str]) -> rrb.Blueprint:
    """Layout of a run: landing points in 3D, one view per seed, and curves. `curves`: entity -> title."""
    spots = [_landings(f"{WORLD}/{seed}", seed) for seed in seeds]
    plots = [rrb.TimeSeriesView(origin=path, name=name, plot_legend=_LEGEND) for path, name in curves.items()]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Grid(*spots), rrb.Grid(*plots, grid_columns=2), column_shares=[1, 1]),
        rrb.TimePanel(state="collapsed", timeline=EPISODE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def eye() -> rrb.EyeControls3D:
    """From the opponent's right: the whole table, the robot's end on the left."""
    return rrb.EyeControls3D(position=(1.5, -3.0, 1.55), look_target=(-0.25, 0.0, 0.0), eye_up=(0, 0, 1))


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
        eye_controls=rrb.EyeControls3D(position=(-0.4, -2.6, 2.6), look_target=(0.3, 0.0, 0.0), eye_up=(0, 0, 1)),
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
