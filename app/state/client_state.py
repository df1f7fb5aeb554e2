"""State of one browser as one frozen value, from which everything shown is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal, get_args

from app.pictures.event_picture import Rendering
from app.pictures.palette import PolarityColours
from app.state.playback import Playhead
from app.state.swept_cells import BoardGuide, SweptCells
from app.state.table_clicks import TableClicks
from app.state.undo import History
from core.detection import DetectorConfig
from core.detection.methods import DEFAULT_METHOD, STAGED, Method, method_config
from core.detection.saved import SavedDetector

ModeName = Literal["Watch", "Tune", "Label", "Train", "Export"]
MODES: Final[tuple[ModeName, ...]] = get_args(ModeName)
Arrangement = Literal["side by side", "stacked"]
ARRANGEMENTS: Final[tuple[Arrangement, ...]] = get_args(Arrangement)
Overlay = Literal["raw", "denoised", "clusters", "polarity", "geometry", "result"]
OVERLAYS: Final[tuple[Overlay, ...]] = get_args(Overlay)
"""Views of Tune: one for each stage, and the result alone."""
Slot = Literal["A", "B"]
SLOTS: Final[tuple[Slot, ...]] = get_args(Slot)


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """Settings of the event pictures, in every mode."""

    window_us: int = 5_000
    """Accumulation window of Watch; Tune shows the detector's own window."""
    rendering: Rendering = "polarity"
    colours: PolarityColours = "orange / blue"
    arrangement: Arrangement = "side by side"


@dataclass(frozen=True, slots=True)
class TuneView:
    """View settings of Tune."""

    overlay: Overlay = "geometry"
    zoom: float = 1.0
    centre_px: tuple[float, float] | None = None
    """Centre of the zoomed view, px; None follows the ball."""
    slot: Slot = "A"
    """The config that the sliders change."""
    compare: bool = False
    """Both configs side by side on the same window."""
    method: Method = DEFAULT_METHOD
    """Method of the sliders, the picture and the scores; Watch, Label and Export detect with it, too."""
    compared: tuple[Method, ...] = ("auto", "refined")
    """Compared methods, in their usual order."""
    side_by_side: bool = False
    """Whether the compared methods are shown side by side, instead of one method's configs."""
    show_truth: bool = True


@dataclass(frozen=True, slots=True)
class WatchView:
    """View settings of Watch."""

    in_space: bool = True
    """Whether it shows 3D (stereo recordings only) or the cameras' pictures."""
    hidden: frozenset[str] = frozenset()
    """Hidden layers."""
    large: str = ""
    """Camera whose picture fills the middle; none if empty."""
    table: TableClicks = field(default_factory=TableClicks)
    swept: SweptCells = field(default_factory=SweptCells)
    board: BoardGuide = field(default_factory=BoardGuide)

    @property
    def framed(self) -> SweptCells:
        """Frames in the cameras' pictures; one of the two coverage guides at a time is active."""
        return self.board.cells if self.board.cells.active else self.swept


@dataclass(frozen=True, slots=True)
class Configs:
    """The two detector configs of a browser."""

    a: DetectorConfig
    b: DetectorConfig

    def of(self, slot: Slot) -> DetectorConfig:
        """The config in a slot."""
        return self.a if slot == "A" else self.b


@dataclass(frozen=True, slots=True)
class ClientState:
    """State of one browser."""

    recording: str
    """Name of the recording in the library."""
    cameras: tuple[str, ...]
    """Names of its cameras."""
    camera: str
    """Camera shown in Tune."""
    playhead: Playhead
    configs: History[Configs]
    """Settings of the methods with stages, which share them."""
    own_configs: Mapping[Method, History[Configs]] = field(default_factory=dict)
    """Settings of each other method that was edited; these have window lengths of their own."""
    mode: ModeName = "Watch"
    step_us: int = 1_000
    marks_us: tuple[int, ...] = ()
    """Marked times of this recording, ascending."""
    look: RenderSettings = field(default_factory=RenderSettings)
    tune: TuneView = field(default_factory=TuneView)
    watch: WatchView = field(default_factory=WatchView)
    looks: int = 0
    """Count of jumps from one mode to a moment in another."""
    score_by: str | None = None
    """Annotator against whose labels Tune is to score next."""

    @property
    def config(self) -> DetectorConfig:
        """The config that the sliders change."""
        return self.config_of(self.tune.method)

    @property
    def detector(self) -> SavedDetector:
        """The chosen method with the config that the sliders change."""
        return SavedDetector(self.tune.method, self.config)

    @property
    def detector_a(self) -> SavedDetector:
        """The chosen method with its config A."""
        return SavedDetector(self.tune.method, self.history.present.a)

    @property
    def history(self) -> History[Configs]:
        """Configs of the chosen method with their undo history."""
        return self.history_of(self.tune.method)

    def config_of(self, method: Method) -> DetectorConfig:
        """Config of a method in the chosen slot."""
        return self.history_of(method).present.of(self.tune.slot)

    def history_of(self, method: Method) -> History[Configs]:
        """The configs of a method; one without stages begins with those there are, in windows of its own length."""
        if method in STAGED:
            return self.configs
        if method in self.own_configs:
            return self.own_configs[method]
        window, present = method_config(method).window, self.configs.present
        return History(Configs(replace(present.a, window=window), replace(present.b, window=window)))

    def with_history(self, history: History[Configs]) -> ClientState:
        """Copy of the state with other configs of the chosen method."""
        if self.tune.method in STAGED:
            return replace(self, configs=history)
        return replace(self, own_configs={**self.own_configs, self.tune.method: history})

    def without_growth(self) -> ClientState:
        """State without the growth of a live recording, which changes no control."""
        return replace(self, playhead=self.playhead.grown(0, 0)) if self.playhead.live else self
