"""Settings of the refined detector."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from core.config import check_settings, setting


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedConfig:
    """The refined detector: its history, and the limits of a ball, in the order of its stages."""

    radius_min_px: float = setting(3.0, 1.0, 100.0, step=0.5, stage="search")
    """Smallest radius of a ball. A first estimate may be 0.6 times as large, a confirmed ball 0.75 times."""
    radius_max_px: float = setting(40.0, 3.0, 300.0, step=0.5, stage="search")
    """Largest radius of a ball. A first estimate may be 1.5 times as large, a blob four times."""
    neighbours_min: int = setting(5, 3, 8, stage="search")
    """Fewest of a pixel's eight neighbours with an event in the same time span: lone noise has none, an edge as wide as
    a pixel has two. Three of them must be beside it, above it or below it."""
    blob_elongation_max: float = setting(3.0, 1.0, 10.0, step=0.1, stage="search")
    """Largest ratio of the sides of a blob, after one cell of 4 px. The tail of a fast ball makes its blob long."""
    trials_max: int = setting(4, 1, 16, stage="candidates")
    """Most blobs fitted in a window; the others wait for the next ones. Each costs one fit of up to 0.2 ms."""
    tracks_max: int = setting(6, 1, 16, stage="candidates")
    """Most candidates followed at once; meanwhile no further blob is fitted."""
    speed_min_px_per_ms: float = setting(0.12, 0.0, 5.0, step=0.01, stage="candidates")
    """Slowest ball."""
    speed_max_px_per_ms: float = setting(25.0, 0.5, 100.0, step=0.5, stage="candidates")
    """Fastest ball."""
    edge: Literal["sharp", "soft"] = field(default="sharp", metadata={"stage": "edge points"})
    """sharp: the ball has a rim, whose first and last events are fitted. soft: a glow, or a ball out of focus, whose
    light falls off over a good part of its radius: all events of the disc are fitted by place and polarity. What the
    limits of a fit then compare is in docs/how/detector.md."""
    trailing: Literal["last", "first"] = field(default="last", metadata={"stage": "edge points"})
    """Which event of a pixel marks the trailing edge. last: it marks the same small coverage of the pixel as the first
    event on the leading edge. first: the first event of the trailing polarity, for a slow receptor (below about 500 Hz)
    whose tail ends late, at a random time; then the edge latency is less, and with it `delay_us`."""
    motion_px: float = setting(3.5, 1.0, 12.0, step=0.5, stage="edge points")
    """History of a fit, in pixels of the ball's motion: enough for both edges to cross whole pixels."""
    history_min_us: int = setting(2000, 500, 20_000, step=100, stage="edge points")
    """Shortest history, for fast balls."""
    history_max_us: int = setting(16_000, 2000, 40_000, step=500, stage="edge points")
    """Longest history, for slow balls: gravity bends their path."""
    points_min: int = setting(12, 5, 200, stage="edge points")
    """Fewest edge points of a fit."""
    stretch_min_ms: float = setting(-0.2, -2.0, 0.0, step=0.05, stage="fit")
    """Smallest edge latency: half of what the trailing edge lags behind the leading one. It is above 0 for a sensor,
    below only by the error of a fit."""
    stretch_max_ms: float = setting(2.5, 0.5, 20.0, step=0.1, stage="fit")
    """Largest edge latency. It was 0.4 to 2 ms on drawn sensors; a slow photoreceptor has more."""
    residual_px: float = setting(0.55, 0.1, 6.0, step=0.05, stage="fit")
    """Largest root mean square distance of the edge points from the circle, robustly weighted."""
    coverage_min: float = setting(0.55, 0.1, 1.0, step=0.05, stage="fit")
    """Smallest share of the circle's sectors with edge points."""
    edge_coverage_min: float = setting(0.25, 0.0, 1.0, step=0.05, stage="fit")
    """Smallest share for the weaker edge, leading or trailing: two of its eight sectors. One edge alone fits many
    circles."""
    inside_max: float = setting(0.3, 0.0, 1.0, step=0.05, stage="fit")
    """Most events inside the disc per event on its rim; a ball has few, a part of a person many."""
    fill_min: float = setting(0.33, 0.0, 1.0, step=0.01, stage="fit")
    """Smallest share of the pixels swept by both edges that have edge points."""
    stray_max: float = setting(0.55, 0.0, 1.0, step=0.05, stage="fit")
    """Largest share of outliers in the band; clutter and random fits have many."""
    fresh_min: float = setting(0.06, 0.0, 1.0, step=0.01, stage="fit")
    """Smallest share of the leading edge's points in the last third of the history. Steady motion brings a third; what
    has vanished none, while a long history alone would still fit."""
    candidate_coast_us: int = setting(3000, 0, 50_000, step=500, stage="track")
    """A candidate that is not yet a ball is dropped after this long without a fit."""
    same_radius: float = setting(0.2, 0.02, 1.0, step=0.01, stage="track")
    """Largest change of a confirmed ball's radius from fit to fit, as a share of it."""
    same_contrast: float = setting(0.5, 0.0, 1.0, step=0.05, stage="track")
    """Smallest number of events of an edge pixel of a confirmed ball, as a share of its mean: what else is there is
    mostly paler."""
    confirm_fits: int = setting(4, 1, 20, stage="track")
    """Consistent fits needed to confirm a ball."""
    evidence_min: float = setting(2.0, 0.0, 6.0, step=0.5, stage="track")
    """Evidence from clean fits that confirms a ball; a dark object needs three times as much, as shadows are dark."""
    both_edges_min: float = setting(0.55, 0.0, 1.0, step=0.05, stage="track")
    """Smallest coverage of the weaker edge, over the last fits, of a ball; a moving limb often shows only one edge."""
    all_round_min: float = setting(0.5, 0.0, 1.0, step=0.05, stage="track")
    """Smallest surplus of one polarity on the leading edge: a ball is brighter, or darker, than its ground nearly all
    round, a striped sleeve is both."""
    steady_radius: float = setting(0.1, 0.02, 1.0, step=0.01, stage="track")
    """Share of the radius within which the last four radii of a ball lie: what emerges from an occlusion grows."""
    confirm_motion_px: float = setting(1.5, 0.0, 20.0, step=0.5, stage="track")
    """Distance it must have moved meanwhile to be confirmed."""
    pace_min_per_ms: float = setting(0.038, 0.0, 1.0, step=0.001, stage="track")
    """Slowest ball in its own radii per ms: 0.038 is 0.76 m/s for one,
    and 3.8 m/s for a head, which is five times as large."""
    given_up: float = setting(-3.0, -12.5, -0.5, step=0.5, stage="track")
    """Evidence at which a candidate is given up: a few bad fits. -12.5 is never reached."""
    confirmed_given_up: float = setting(-5.0, -12.5, -0.5, step=0.5, stage="track")
    """The same for a confirmed ball, which may pass clutter."""
    coast_us: int = setting(12_000, 0, 100_000, step=1000, stage="track")
    """An unseen ball is predicted for this long."""
    # No number holds for all sensors. By truth, the delay with the least median error, mean over the cameras (serves of
    # 5 and 8 m/s, seeds 7480000 and 7480010, `simulate_recording`, `find_delay_us`): standard sensor 255 (245 to 270,
    # twelve views of the placements side and corners), the same with 2 Hz of noise, 264 in the dark, 257 with a person.
    # Photoreceptors of 100 and 400 us: 116 and 511; thresholds of 0.1 and 0.4: 295 and 246; 300 us of refractory time:
    # 131; low contrast: 303. So 255 would suit the simulation better (median error 0.09 px instead of 0.11), and says
    # nothing of another sensor: time constant, refractory time, threshold and contrast decide.
    delay_us: int = setting(230, 0, 5000, step=10, stage="result")
    """An estimate holds for the end of the window less this. About the photoreceptor's time constant, and longer in the
    dark: one number for a sensor. 230 is that of the simulation's; `detect --json` estimates it."""

    def __post_init__(self) -> None:
        check_settings(self)
