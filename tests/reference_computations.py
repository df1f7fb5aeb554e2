"""How every reference output is computed: with fixed seeds, through the command line where it has a verb.

The names of modules that this takes stand in the imports and nowhere else, so that few lines follow when modules move.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import numpy as np

from app.cli.main import main as rallyscope
from app.modes.watch.status import landing_legend_html, live_html, moment_html
from app.pictures.canvas import Canvas, Region, event_picture
from app.views.stage_picture import draw_stage
from benchmarks.rally.closed_loop import ClosedLoop
from core.cameras import load_calibration
from core.chain.control.player import PlayerState
from core.detection import DetectorConfig, FastDetector, ReferenceDetector, TrackState, trace_window
from core.detection.staged_view import view_of
from core.events import Window
from core.history.following import Following
from core.live.link import messages
from core.live.worlds.world import Block, SimulatedWorld, WorldConfig
from core.physics import strokes_from_actions
from core.physics.config import Profile
from core.physics.task import task_profile
from core.recordings import open_recording
from core.simulation import ensure_demo
from core.simulation.episodes import draw_serves, fly_serves, return_balls
from tests.reference_arrays import Arrays, bytes_array, read_files, read_hdf5, stacked, text_arrays, text_columns

STORED: Final = Path(__file__).parent / "fixtures" / "written-by-0.1"
"""Files that do not depend on the code of today."""
RENDERINGS: Final = ("polarity", "count", "time surface")
OVERLAYS: Final = ("raw", "denoised", "clusters", "polarity", "geometry", "result")


@dataclass(frozen=True, slots=True)
class Bench:
    """Where outputs are computed."""

    folder: Path
    """Empty at first, gone afterwards."""

    @property
    def demo(self) -> Path:
        """The demo recording, made on first use."""
        path = self.folder / "demo.h5"
        ensure_demo(path)
        return path

    @property
    def dark(self) -> Path:
        """A recording of a dark ball, whose leading edge is OFF; made on first use."""
        path = self.folder / "dark.h5"
        if not path.exists():
            side = STORED / "calibrations" / "side.toml"
            run_verb("simulate", "--out", path, "--serves", 1, "--seed", 6, "--scene", "dark", "--cameras", side)
        return path

    def new(self, name: str) -> Path:
        """A path where nothing is yet."""
        return Path(tempfile.mkdtemp(dir=self.folder)) / name


def run_verb(*words: object) -> str:
    """What `rallyscope` prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = rallyscope([str(word) for word in words])
    if code:
        raise SystemExit(f"rallyscope {' '.join(map(str, words))}: ended with {code}")
    return printed.getvalue()


def simulate(*words: object, cameras: str = "wide") -> Callable[[Bench], Arrays]:
    """A simulated recording of one serve."""

    def compute(bench: Bench) -> Arrays:
        out = bench.new("simulated.h5")
        rig = () if cameras == "" else ("--cameras", STORED / "calibrations" / f"{cameras}.toml")
        run_verb("simulate", "--out", out, "--serves", 1, "--seed", 5, *rig, *words)
        return read_hdf5(out)

    return compute


def demo_beginning(bench: Bench) -> Arrays:
    """The demo's first 100 ms, and how much there is of the rest."""
    with contextlib.closing(open_recording(bench.demo)) as recording:
        columns: Arrays = {"duration_us": np.array(recording.duration_us)}
        for name, camera in recording.cameras.items():
            events = camera.slice(0, 100_000)
            columns |= {f"{name}/{key}": getattr(events, key) for key in ("t_us", "x_px", "y_px", "on")}
            columns[f"{name}/events per ms"] = camera.counts_per_ms()
        return columns


def detect(source: str, camera: str, method: str, config: str | None = None) -> Callable[[Bench], Arrays]:
    """The table that `detect` writes."""

    def compute(bench: Bench) -> Arrays:
        settings = () if config is None else ("--config", STORED / "configs" / f"{config}.toml")
        out = bench.new("balls.csv")
        words = ("--camera", camera, "--method", method, *settings, "--out", out)
        run_verb("detect", recording_of(bench, source), *words)
        return text_arrays(out)

    return compute


def recording_of(bench: Bench, source: str) -> Path:
    """The demo, a simulated recording of a dark ball, or a stored recording."""
    if source == "demo":
        return bench.demo
    if source == "dark":
        return bench.dark
    return STORED / "recordings" / f"{source}.h5"


def windows_of(source: str, start_us: int, end_us: int, window_us: int) -> Iterator[Window]:
    """Windows of the left camera of a stored recording."""
    with contextlib.closing(open_recording(STORED / "recordings" / f"{source}.h5")) as recording:
        camera = recording.cameras["left"]
        for at_us in range(start_us, end_us, window_us):
            yield Window(camera.slice(at_us, at_us + window_us), at_us, at_us + window_us)


def both_paths(bench: Bench) -> Arrays:
    """The readable pipeline and the fast path, window by window."""
    config = DetectorConfig()
    readable, fast = ReferenceDetector(config), FastDetector(config)
    rows: dict[str, list[list[float]]] = {"readable": [], "fast": []}
    for window in windows_of("robot", 380_000, 500_000, 2000):
        for name, detector in (("readable", readable), ("fast", fast)):
            found = detector.step(window)
            place = [np.nan] * 3 if found is None else [found.u_px, found.v_px, found.r_px]
            rows[name].append([window.end_us, *place, detector.extra_circles])
    return {name: np.array(values) for name, values in rows.items()}


def stages(bench: Bench) -> Arrays:
    """What every stage keeps of every event, and why candidates are rejected."""
    state, config = TrackState(), DetectorConfig()
    kept: list[list[int]] = []
    reasons: list[str] = []
    for window in windows_of("robot", 380_000, 440_000, 2000):
        trace = trace_window(window, state, config)
        state = trace.state
        kept.append([len(stage.events) for stage in trace.stages])
        reasons += [f"{one.label} {one.size} {one.rejected_by} {one.rejected}" for one in trace.candidates]
    return {"kept": np.array(kept), **text_columns("candidates", "\n".join(reasons))}


def track(source: str, method: str) -> Callable[[Bench], Arrays]:
    """The table that `track` writes."""

    def compute(bench: Bench) -> Arrays:
        out = bench.new("track.csv")
        run_verb("track", recording_of(bench, source), "--method", method, "--out", out)
        return text_arrays(out)

    return compute


def predict(method: str, *physics: str) -> Callable[[Bench], Arrays]:
    """What `predict` writes, from the stored track before and after its bounce."""

    def compute(bench: Bench) -> Arrays:
        points = bench.new("points.csv")
        rows = np.loadtxt(STORED / "track.csv", delimiter=",", skiprows=1)
        rows[:, 0] *= 1e-6
        np.savetxt(points, rows, delimiter=",", header="t_s,x_m,y_m,z_m", comments="", fmt="%.6f")
        arrays: Arrays = {}
        for seen_ms in (110, 300):
            out = bench.new(f"{seen_ms} ms.json")
            run_verb("predict", points, "--observe-ms", seen_ms, "--method", method, *physics, "--out", out)
            arrays |= text_arrays(out)
        return arrays

    return compute


def closed_loop(bench: Bench) -> Arrays:
    """A ball through perception to the racket and back, and all that was seen and decided."""
    heard: list[Arrays] = []

    def hear(block: Block, states: list[PlayerState]) -> None:
        heard.append(block_columns(block))
        for state in states:
            prediction = state.chain.prediction
            hit = None if prediction is None else prediction.hit_plane
            heard.append({"prediction": np.full((1, 3), np.nan) if hit is None else hit.p_world_m[None]})

    loop = ClosedLoop(
        WorldConfig(), load_calibration(STORED / "calibrations" / "side.toml"), seed=5, knows_physics=True
    )
    try:
        ball = loop.play(5.0, hear)
    finally:
        loop.close()
    commands = [[one.target.t_s, *one.target.p_m, *one.target.q_wxyz, *one.action] for one in ball.decisions]
    outcome = {f"outcome/{name}": value for name, value in columns_of(ball.judged.outcome).items()}
    return {**stacked(heard), "commands": np.array(commands), "arrival": ball.judged.arrival, **outcome}


def live_world(bench: Bench) -> Arrays:
    """A second of the world of the live rally, with a serve that nobody answers."""
    world = SimulatedWorld(WorldConfig(), load_calibration(STORED / "calibrations" / "wide.toml"), 7)
    try:
        world.draw_serve(6.0)
        return stacked([block_columns(world.advance()) for _ in range(100)])
    finally:
        world.close()


def columns_of(value: object) -> Arrays:
    """The fields of a dataclass that are numbers or arrays."""
    assert dataclasses.is_dataclass(value)
    columns = {one.name: np.asarray(getattr(value, one.name)) for one in dataclasses.fields(value)}
    return {name: column for name, column in columns.items() if column.dtype.kind in "biuf"}


def block_columns(block: Block) -> Arrays:
    """What a block of the world says."""
    columns: Arrays = {"racket": block.racket, "ball": block.ball.p_world_m, "spin": block.ball.spin_radps}
    for name, events in block.events.items():
        columns |= {f"{name}/{key}": getattr(events, key) for key in ("t_us", "x_px", "y_px", "on")}
        circle = block.circles[name]
        columns[f"{name}/circle"] = np.column_stack([circle.u_px, circle.v_px, circle.r_px])
    return columns


def wire(bench: Bench) -> Arrays:
    """Messages of the simulation link as bytes."""
    cameras = load_calibration(STORED / "calibrations" / "side.toml")
    infos = tuple(messages.CameraInfo.of(name, camera) for name, camera in cameras.items())
    physics = task_profile("real").physics
    sent = (
        messages.Reply(id=1, ok=True, session="s", t_us=0, block_us=10_000, seed=1, cameras=infos, physics=physics),
        live_state(),
        messages.Hello(id=1),
        messages.Serve(id=2, speed_mps=6.5),
        messages.AimRacket(id=3, p_m=(-1.4, 0, 0.2), q_wxyz=(1, 0, 0, 0), v_mps=(1, 0, 0), t_us=500),
    )
    return {type(one).__name__: bytes_array(messages.encode(one)) for one in sent}


def live_state() -> messages.WorldState:
    """A state of the live rally in which the readout is late."""
    times_us = np.array([0, 500])
    return messages.WorldState(
        session="s", seq=3, wall_ns=5, start_us=0, t_us=10_000, phase="serve", paused=False, speed_factor=1.0,
        noise_hz=0.1, auto_serve_mps=0.0, real_time_factor=0.8, served=1, returned=0, ball_t_us=times_us,
        ball=np.arange(18.0).reshape(2, 9), ball_visible=np.array([1, 0], np.uint8), racket_t_us=times_us,
        racket=np.arange(20.0).reshape(2, 10), readout_delayed=1200, readout_dropped=34, readout_longest_us=70,
    )  # fmt: skip


def train(agent: str, episodes: int) -> Callable[[Bench], Arrays]:
    """Training curves, evaluations and the last policy."""

    def compute(bench: Bench) -> Arrays:
        run = bench.new("run")
        run_verb("train", "--agent", agent, "--speeds", 5, "--episodes", episodes, "--out", run)
        arrays: Arrays = {}
        for name in ("metrics.jsonl", "evaluations.jsonl"):
            arrays |= text_arrays(run / "seed-0" / name)
        return arrays | text_columns("evaluate", run_verb("evaluate", run, "--balls", 100, "--json"))

    return compute


def evaluate(run: str) -> Callable[[Bench], Arrays]:
    """A stored training on its fixed balls."""
    return lambda bench: text_columns("evaluate", run_verb("evaluate", STORED / "runs" / run, "--json"))


def export_labels(form: str) -> Callable[[Bench], Arrays]:
    """The stored labels for another tool."""

    def compute(bench: Bench) -> Arrays:
        out = bench.new("labels.h5" if form == "hdf5" else "labels")
        whose = ("--camera", "left", "--annotator", "anna", "--data", STORED)
        how = ("--format", form, "--out", out, "--unchecked", "drop", "--stride-us", 2000)
        pictures = ("--pictures",) if form in ("voc", "yolo", "coco") else ()
        report = run_verb("labels", "export", recording_of(bench, "robot"), *whose, *how, *pictures)
        return read_files(out) | text_columns("report", report.replace(str(out), "OUT"))

    return compute


def measure_labels(*words: object) -> Callable[[Bench], Arrays]:
    """What `labels` reports of the stored labels."""
    whose = ("--camera", "left", "--annotator", "anna", "--data", STORED, "--json")
    robot = STORED / "recordings" / "robot.h5"
    return lambda bench: text_columns("report", run_verb("labels", words[0], robot, *whose, *words[1:]))


def export(form: str, *words: object, source: str = "robot") -> Callable[[Bench], Arrays]:
    """A part of a stored recording for other tools."""

    def compute(bench: Bench) -> Arrays:
        out = bench.new(f"export.{form}" if form == "png" else form)
        part = ("--start-us", 300_000, "--end-us", 500_000)
        run_verb("export", STORED / "recordings" / f"{source}.h5", f"--{form}", out, *part, *words)
        return read_files(out)

    return compute


def digests(compute: Callable[[Bench], Arrays]) -> Callable[[Bench], Arrays]:
    """Eight bytes for each array, where stored events are only written otherwise: that rounds nothing, and is much."""

    def compute_digests(bench: Bench) -> Arrays:
        return {
            f"{name}: {array.dtype.str} {array.shape}": bytes_array(blake2b(array.tobytes(), digest_size=8).digest())
            for name, array in compute(bench).items()
        }

    return compute_digests


def describe(name: str) -> Callable[[Bench], Arrays]:
    """What `info` says of a stored recording."""
    path = STORED / "recordings" / f"{name}.h5"
    return lambda bench: text_columns("info", run_verb("info", path, "--json").replace(str(path), "PATH"))


def physics(profile: Profile) -> Callable[[Bench], Arrays]:
    """Serves, their arrivals, and what comes of strokes."""

    def compute(bench: Bench) -> Arrays:
        task, rng = task_profile(profile), np.random.default_rng(3)
        arrays: Arrays = {}
        for speed_mps in (3.0, 5.0, 9.0):
            serves = draw_serves(speed_mps, 100, task, rng)
            arrivals = fly_serves(serves, task)
            strokes = strokes_from_actions(rng.uniform(-1, 1, (100, 3)), 1.0, task.stroke)
            outcomes = return_balls(arrivals, strokes, task)
            parts = {"serves": serves, "arrivals": arrivals, "outcomes": outcomes}
            for part, value in parts.items():
                arrays |= {f"{speed_mps:g} m/s/{part}/{name}": array for name, array in columns_of(value).items()}
        return arrays

    return compute


def pictures(bench: Bench) -> Arrays:
    """Events of a window in every rendering."""
    (window,) = windows_of("robot", 400_000, 402_000, 2000)
    return {
        f"{rendering}, {binning}": event_picture(window, rendering, binning=binning)
        for rendering in RENDERINGS
        for binning in (1, 2)
    }


def stage_pictures(bench: Bench) -> Arrays:
    """Every stage of a window, whole and magnified, the way Tune draws it."""
    arrays: Arrays = {}
    *before, window = windows_of("robot", 390_000, 402_000, 2000)
    state = TrackState()
    for earlier in before:
        state = trace_window(earlier, state, DetectorConfig()).state
    trace = trace_window(window, state, DetectorConfig())
    sensor = window.events.sensor
    for name, region in (("whole", Region.of_sensor(sensor)), ("part", Region.around(160.0, 100.0, sensor, 4.0))):
        for overlay in OVERLAYS:
            canvas = Canvas(region)
            draw_stage(canvas, window, view_of(trace, window, DetectorConfig()), overlay, "polarity")
            arrays[f"{overlay}, {name}"] = canvas.image
    return arrays


def watch_status(bench: Bench) -> Arrays:
    """The rally in figures, at moments of the stored live recording and for a fixed state of the live rally."""
    arrays = text_columns("legend", landing_legend_html())
    with contextlib.closing(open_recording(STORED / "recordings" / "live.h5")) as recording:
        following = Following(recording)
        following.wait()
        places = {name: camera.position_world_m for name, camera in following.cameras.items()}
        for t_us in range(0, recording.duration_us, 125_000):
            moment = following.history.at(t_us, places)
            arrays |= text_columns(f"at {t_us}", moment_html(moment, 15.0, following.share))
    span = SimpleNamespace(p50_ms=0.2, p99_ms=1.0)
    health = SimpleNamespace(state_hz=400.0, step=span, window_to_sent=span, blocks_dropped=2, stages=())
    snapshot = SimpleNamespace(health=health, controller="built-in", problem="<none>", learned=None)
    return arrays | text_columns("live", live_html(snapshot, live_state(), "lost"))  # type: ignore[arg-type]
