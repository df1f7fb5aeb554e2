"""State of one browser as one frozen value, from which everything shown is computed.

The time cursor of one browser: a pure value that gives its position at any wall-clock time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Generic, Literal, TypeVar, get_args

from app.pictures.canvas import Rendering
from app.pictures.palette import PolarityColours
from app.state.swept_cells import BoardGuide, SweptCells, TableClicks
from core.chain.config import PredictionName
from core.detection import DetectorConfig
from core.detection.methods import DEFAULT_METHOD, STAGED, VIEWS, Method, method_config
from core.detection.saved import SavedDetector

V = TypeVar("V")

SpaceColour = Literal["stage", "cluster", "polarity", "verdict"]
"""What colours a window's events in space and time: as in the stage's picture, each candidate in its own colour, ON and
OFF, or candidates by verdict."""
SPACE_COLOURS: Final[tuple[SpaceColour, ...]] = get_args(SpaceColour)

MERGE_WITHIN_S = 0.8
"""Changes of one setting closer than this are one step: a slider sends some twenty a second while it is dragged."""


@dataclass(frozen=True, slots=True)
class History(Generic[V]):
    """A value with its undo and redo history."""

    present: V
    past: tuple[V, ...] = ()
    future: tuple[V, ...] = ()
    last_topic: object = None
    last_wall_s: float = float("-inf")

    def change(self, value: V, *, topic: object, wall_s: float) -> History[V]:
        """History with a new value; merged with the previous step if that was recent and had the same topic."""
        if value == self.present:
            return self
        joins = topic is not None and topic == self.last_topic and wall_s - self.last_wall_s < MERGE_WITHIN_S
        past = self.past if joins else (*self.past, self.present)
        return History(value, past, (), topic, wall_s)

    def undo(self) -> History[V]:
        """History before the last step; unchanged if there is none."""
        if not self.past:
            return self
        return replace(self._at(self.past[-1]), past=self.past[:-1], future=(self.present, *self.future))

    def redo(self) -> History[V]:
        """History after redoing; unchanged if there is nothing to redo."""
        if not self.future:
            return self
        return replace(self._at(self.future[0]), past=(*self.past, self.present), future=self.future[1:])

    def _at(self, value: V) -> History[V]:
        return replace(self, present=value, last_topic=None)


SPEEDS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
SHORTEST_LOOP_US: Final = 100
STEPS_US: Final = (1, 10, 100, 500, 1_000, 2_000, 5_000, 10_000, 100_000, 1_000_000)


@dataclass(frozen=True, slots=True)
class Playhead:
    """Where in a recording the end of the shown window is; while it plays it moves with the wall clock."""

    duration_us: int
    anchor_us: int = 0
    """Position at `anchor_wall_s`; the position as long as it is paused."""
    anchor_wall_s: float = 0.0
    playing: bool = False
    speed: float = 0.05
    start_us: int = 0
    """Start of the available time; above 0 in a live recording only."""
    live: bool = False
    """Whether the recording is live: at its end the cursor follows it instead of stopping."""
    following: bool = False
    """Whether the cursor follows the end of a live recording."""
    loop_us: tuple[int, int] | None = None
    """Start and end of a section that is repeated once the cursor is in it."""

    def position_us(self, wall_s: float) -> int:
        """Position at a wall-clock time, in [start, duration]."""
        if self.following:
            return self.duration_us
        moved = self.speed * (wall_s - self.anchor_wall_s) * 1e6 if self.playing else 0.0
        return self._inside(self._looped(self.anchor_us + moved))

    @property
    def is_playback(self) -> bool:
        """Whether it plays what no longer changes: the last events of a live recording may still arrive."""
        return self.playing and not self.live

    def grown(self, start_us: int, duration_us: int) -> Playhead:
        """Cursor after a live recording has grown."""
        return replace(self, start_us=start_us, duration_us=duration_us)

    def seek(self, t_us: int, wall_s: float) -> Playhead:
        """Cursor at another time; playing or paused as before."""
        return replace(self, anchor_us=self._inside(t_us), anchor_wall_s=wall_s, following=False)

    def looping(self, section_us: tuple[int, int] | None, wall_s: float) -> Playhead:
        """The cursor with a section to repeat, moved to its start if it is outside; None ends the loop."""
        head = replace(self.seek(self.position_us(wall_s), wall_s), loop_us=None)
        if section_us is None:
            return head
        start_us, end_us = (head._inside(t_us) for t_us in sorted(section_us))
        if end_us - start_us < SHORTEST_LOOP_US:
            return head
        here_us = head.anchor_us if start_us <= head.anchor_us < end_us else start_us
        return replace(head, loop_us=(start_us, end_us), anchor_us=here_us)

    def _looped(self, t_us: float) -> float:
        if self.loop_us is None or not self.playing:
            return t_us
        start_us, end_us = self.loop_us
        inside = start_us <= self.anchor_us < end_us <= t_us
        return start_us + (t_us - start_us) % (end_us - start_us) if inside else t_us

    def _inside(self, t_us: float) -> int:
        return int(min(max(t_us, self.start_us), self.duration_us))

    def step(self, by_us: int, wall_s: float) -> Playhead:
        """Cursor paused, `by_us` later."""
        return replace(self, playing=False).seek(self.position_us(wall_s) + by_us, wall_s)

    def play(self, wall_s: float) -> Playhead:
        """Cursor playing: from the start if it was at the end; a live recording is followed unless in slow motion."""
        if self.live and (self.speed >= 1 or self.position_us(wall_s) >= self.duration_us):
            return replace(self, playing=True, following=True)
        start_us = self.position_us(wall_s)
        if start_us >= self.duration_us:
            start_us = 0
        return replace(self.seek(start_us, wall_s), playing=True)

    def pause(self, wall_s: float) -> Playhead:
        """Cursor paused at its position."""
        return replace(self.seek(self.position_us(wall_s), wall_s), playing=False)

    def at_speed(self, speed: float, wall_s: float) -> Playhead:
        """The cursor moving at `speed` recording seconds per second."""
        if not (math.isfinite(speed) and speed > 0):
            return self
        return replace(self.seek(self.position_us(wall_s), wall_s), speed=speed)

    def settle(self, wall_s: float) -> Playhead:
        """Cursor after reaching the end: paused, or following a live recording."""
        if not self.playing or self.following or self.position_us(wall_s) < self.duration_us:
            return self
        return replace(self, following=True) if self.live else self.pause(wall_s)


ModeName = Literal["Watch", "Tune", "Label", "Train", "Export"]
MODES: Final[tuple[ModeName, ...]] = get_args(ModeName)
Arrangement = Literal["automatic", "side by side", "stacked"]
ARRANGEMENTS: Final[tuple[Arrangement, ...]] = get_args(Arrangement)
Overlay = str
"""Name of a view of Tune: each method has one for each of its stages, see `core.detection.methods.VIEWS`."""
MOST_VIEWS: Final = 7
"""Views of a method that have a key, 1 to 7."""
Slot = Literal["A", "B"]
SLOTS: Final[tuple[Slot, ...]] = get_args(Slot)


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """Settings of the event pictures, in every mode."""

    window_us: int = 5_000
    """Accumulation window of Watch; Tune shows the detector's own window."""
    rendering: Rendering = "polarity"
    colours: PolarityColours = "orange / blue"
    arrangement: Arrangement = "automatic"
    """Automatic: what fills more of the middle in Export, side by side elsewhere."""
    magnifies_ball: bool = True
    """Whether pictures of whole sensors show the ball magnified in a corner."""


@dataclass(frozen=True, slots=True)
class PickedPoint:
    """A point of a camera's picture at a time; the cluster there is the chosen one."""

    camera: str
    t_us: int
    point_px: tuple[float, float]


@dataclass(frozen=True, slots=True)
class TuneView:
    """View settings of Tune."""

    overlay: Overlay = "geometry"
    """The chosen view; a method that has none of this name shows its result."""
    zoom: float = 1.0
    centre_px: tuple[float, float] | None = None
    """Centre of the zoomed view, px; None follows the ball."""
    picked: PickedPoint | None = None
    """The last click into a picture, or into events in space and time; Label's clicks there, too."""
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
    in_space: bool = False
    """Whether the window's events are shown in space and time instead of as a picture."""
    space_colour: SpaceColour = "stage"
    frames: str = ""
    """Title of the ordinary camera whose picture nearest to the cursor stands beside the events; none if empty."""

    @property
    def shows_space(self) -> bool:
        """Whether events in space and time are shown: compared methods are pictures always."""
        return self.in_space and not self.side_by_side

    @property
    def stage(self) -> Overlay:
        """The view that is shown of the method."""
        views = VIEWS[self.method]
        return self.overlay if self.overlay in views else views[-1]


@dataclass(frozen=True, slots=True)
class WatchView:
    """View settings of Watch."""

    in_space: bool = True
    """Whether it shows 3D (stereo recordings only) or the cameras' pictures."""
    hidden: frozenset[str] = frozenset()
    """Hidden layers."""
    prediction: PredictionName | None = None
    """How hits are predicted in recordings; None: as the server was told."""
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
class LabelChoices:
    """What a reload keeps of Label's view."""

    zoom: float = 1.0
    compared: str = ""
    """Title of the labels beside one's own; "": none."""
    proposed: bool = False
    """Whether there are proposals, which a reload does not keep."""


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
    """Names of its event cameras."""
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
    label: LabelChoices = field(default_factory=LabelChoices)
    looks: int = 0
    """Count of jumps from one mode to a moment in another."""
    annotator: str | None = None
    """Who labels in this browser; None until that was said."""
    score_by: str | None = None
    """Annotator against whose labels Tune is to score next."""
    frame_cameras: tuple[str, ...] = ()
    """Names of the frame cameras that are followed beside its event cameras."""
    titled_frames: tuple[str, ...] = ()
    """Titles of all its ordinary cameras, calibrated or not."""

    @property
    def seen_cameras(self) -> tuple[str, ...]:
        """Every camera with a picture beside the scene, the event cameras first."""
        return (*self.cameras, *self.frame_cameras)

    @property
    def config(self) -> DetectorConfig:
        """The config that the sliders change."""
        return self.config_of(self.tune.method)

    @property
    def detector(self) -> SavedDetector:
        """The chosen method with the config that the sliders change: every mode detects with it."""
        return SavedDetector(self.tune.method, self.config)

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
