"""Trial of the search for shifts of labels: rallies simulated in Sony's layout, labels moved by a drawn time and place.

Rallies are imported and their labels are read back as a user would. The delay of the simulated photoreceptor is in the
events and counts as an error of the result.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import h5py
import numpy as np
import yaml
from numpy.typing import NDArray

from core.cameras import Camera, stereo_preset
from core.detection.methods import make_detector, method_config
from core.geometry import invert_transform
from core.metrics import run_detector
from core.recordings import (
    BallTruth,
    CameraStream,
    ImportOrder,
    PixelTruth,
    Recording,
    import_recording,
    open_recording,
)
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from labels.assist.label_shift import LabelShift, find_label_shift
from labels.formats import ImportContext
from labels.formats.import_check import import_labels

Array = NDArray[np.float64]
T0_US: Final = 1_700_000_000_000_000
FARTHEST_US: Final = 20_000
FARTHEST_PX: Final = 30.0
NEAR_US, NEAR_PX = 300.0, 0.3
"""What is nearer to the drawn shift than this is found."""
T_WO: Final = np.array([[1.0, 0, 0, 0.4], [0, 0, -1, -0.1], [0, 1, 0, 3], [0, 0, 0, 1]])
"""Some pose of the table's frame in that of the calibration."""
NAMES: Final = {"left": "evs00050026", "right": "evs00050027"}


@dataclass(frozen=True, slots=True)
class DrawnShift:
    """What has to be added to labels so that they fit the events."""

    dt_us: int = 0
    du_px: float = 0.0
    dv_px: float = 0.0

    def found_by(self, shift: LabelShift) -> bool:
        """Whether it was found, as near as it has to be."""
        off_px = max(abs(shift.du_px - self.du_px), abs(shift.dv_px - self.dv_px))
        return shift.found and abs(shift.dt_us - self.dt_us) < NEAR_US and off_px < NEAR_PX


def draw_shift(rng: np.random.Generator) -> DrawnShift:
    """-20 to 20 ms, and 0 to 30 px in any direction."""
    angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0, FARTHEST_PX)
    dt_us = round(float(rng.uniform(-FARTHEST_US, FARTHEST_US)))
    return DrawnShift(dt_us, float(size * np.cos(angle)), float(size * np.sin(angle)))


@dataclass(frozen=True, slots=True)
class ShiftTrial:
    """How often a shift was found."""

    shifted: int
    found: int
    """How many of the shifted ones, as near as they have to be."""
    unshifted: int
    said_zero: int
    unrelated: int
    """Searches with labels of another rally."""
    invented: int
    """How many of the unrelated ones where a shift was found all the same."""
    errors_us: Array
    errors_px: Array


def try_shifts(folder: Path, rng: np.random.Generator, *, rallies: int, draws: int) -> ShiftTrial:
    """Make rallies, shift the labels of each as often as drawn, and search."""
    made = [make_rally(folder / f"capture_{number}", rng, number) for number in range(rallies)]
    drawn: list[tuple[DrawnShift, LabelShift]] = []
    said_zero = invented = 0
    for number, capture in enumerate(made):
        with open_recording(capture.recording) as recording:
            stream = recording.cameras[NAMES["left"]]
            times, places = _answers(stream)
            for _ in range(draws):
                shift = draw_shift(rng)
                drawn.append((shift, _found(capture, recording, stream, capture.truth, shift, times, places)))
            none = _found(capture, recording, stream, capture.truth, DrawnShift(), times, places)
            said_zero += none.is_zero
            other = made[(number + 1) % rallies].truth
            invented += _found(capture, recording, stream, other, DrawnShift(), times, places).found
    errors = [
        (abs(shift.dt_us - by.dt_us), max(abs(shift.du_px - by.du_px), abs(shift.dv_px - by.dv_px)))
        for by, shift in drawn
    ]
    table = np.array(errors).reshape(-1, 2)
    found = sum(by.found_by(shift) for by, shift in drawn)
    return ShiftTrial(len(drawn), found, rallies, said_zero, rallies, invented, table[:, 0], table[:, 1])


@dataclass(frozen=True, slots=True)
class Capture:
    """A rally in Sony's layout, and the recording that was imported from it."""

    folder: Path
    name: str
    recording: Path
    truth: PixelTruth
    """Truth of the first camera, its times after t0."""


def make_rally(folder: Path, rng: np.random.Generator, number: int) -> Capture:
    """Simulate three serves, write both cameras in Sony's layout, and import them."""
    simulated = folder / "simulated.h5"
    folder.mkdir(parents=True)
    serves = [LaunchConfig(speed_mps=float(rng.uniform(3, 7))) for _ in range(3)]
    cameras = stereo_preset("side")
    simulate_recording(simulated, StereoConfig(), cameras, serves, seed=int(rng.integers(1 << 31)))
    name = f"seq_{number:03d}_rally"
    with open_recording(simulated) as recording:
        write_capture(folder, name, recording)
        truth = recording.cameras["left"].truth
    assert truth is not None, "the simulator knows it"
    path = folder / "imported.h5"
    import_recording(ImportOrder([folder / "h5"]), path)
    return Capture(folder, name, path, truth)


def write_capture(folder: Path, name: str, recording: Recording, shift: DrawnShift | None = None) -> None:
    """Events, labels, metadata and the calibration of a recording of ours, as Sony publishes them."""
    tree: dict[str, object] = {"T_WO": T_WO.tolist()}
    ball = recording.ball
    for own, stream in recording.cameras.items():
        camera, truth = stream.calibration, stream.truth
        assert camera is not None and truth is not None and ball is not None, "the simulator knows them"
        tree[NAMES[own]] = _calibration_entry(camera)
        here = folder / "h5" / NAMES[own]
        write_events(here / f"{name}.h5", stream, recording.duration_us)
        write_labels(here / f"{name}_label.h5", truth, shift or DrawnShift(), recording.duration_us)
        write_metadata(folder / "metadata" / NAMES[own] / f"{name}.csv", ball, recording.duration_us)
    (folder / "rig.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")


def _calibration_entry(camera: Camera) -> dict[str, object]:
    T_CW = invert_transform(camera.T_world_camera) @ invert_transform(T_WO)
    return {
        "resolution": [camera.sensor.width_px, camera.sensor.height_px],
        "camera_matrix": camera.K.tolist(),
        "distortion_coeffs": camera.distortion[:5].tolist(),
        "T_CW": T_CW.tolist(),
    }


def write_events(path: Path, stream: CameraStream, duration_us: int, t0_us: int = T0_US) -> None:
    """The events of a camera, their times after t0."""
    path.parent.mkdir(parents=True, exist_ok=True)
    events = stream.slice(0, duration_us)
    with h5py.File(path, "w") as file:
        file["events/x"], file["events/y"] = events.x_px, events.y_px
        file["events/p"], file["events/t"] = events.on.astype("u1"), events.t_us
        file["t0"] = np.array([t0_us], "i8")
        file["ms_to_idx"] = np.searchsorted(events.t_us, np.arange(0, duration_us, 1000)).astype("u4")


def write_labels(path: Path, truth: PixelTruth, shift: DrawnShift, duration_us: int) -> None:
    """A label each millisecond, which the shift would bring back to the truth; nan where the ball is not seen."""
    path.parent.mkdir(parents=True, exist_ok=True)
    t_us = np.arange(500, duration_us, 1000)
    at = truth.at(t_us + shift.dt_us)
    points = np.stack([at.u_px - shift.du_px, at.v_px - shift.dv_px], axis=1)
    with h5py.File(path, "w") as file:
        for name in ("points", "points_orig"):
            file[name] = points
        for name in ("radius", "radius_orig"):
            file[name] = at.r_px
        file["velocities"] = np.gradient(points, 1e-3, axis=0)
        file["timestamps"] = 41.5 + t_us / 1e6


def write_metadata(path: Path, ball: BallTruth, duration_us: int) -> None:
    """The ball in the calibration's frame W, a row each millisecond; empty where it is not known."""
    path.parent.mkdir(parents=True, exist_ok=True)
    p = ball.p_world_m @ T_WO[:3, :3].T + T_WO[:3, 3]
    v = ball.v_world_mps @ T_WO[:3, :3].T
    axes = [f"{kind}_{axis}_label" for kind in ("pos", "vel") for axis in "xyz"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["timestamps", *axes])
        for t_us in range(500, duration_us, 1000):
            row = int(np.clip(np.searchsorted(ball.t_us, t_us), 1, max(1, len(ball.t_us) - 1)))
            known = bool(ball.visible[row - 1] and ball.visible[row])
            weight = (t_us - ball.t_us[row - 1]) / (ball.t_us[row] - ball.t_us[row - 1])
            mixed = [(1 - weight) * column[row - 1] + weight * column[row] for column in (p, v)]
            writer.writerow([f"{41.5 + t_us / 1e6:.6f}", *(np.concatenate(mixed).tolist() if known else [""] * 6)])


def _answers(stream: CameraStream) -> tuple[NDArray[np.int64], Array]:
    config = method_config("refined")
    detector = make_detector("refined", stream.sensor, config)
    answers = run_detector(stream, detector, config.window.window_us)
    found = answers.rows(answers.detected)
    return found.t_us, np.stack([found.u_px, found.v_px], axis=1)


def _found(
    capture: Capture,
    recording: Recording,
    stream: CameraStream,
    truth: PixelTruth,
    by: DrawnShift,
    times: NDArray[np.int64],
    places: Array,
) -> LabelShift:
    """Write labels beside the events, read them as an import does, and search for their shift."""
    file = capture.folder / "h5" / NAMES["left"] / f"{capture.name}_label.h5"
    write_labels(file, truth, by, recording.duration_us)
    context = ImportContext(
        stream.sensor,
        None,
        "",
        stream.name,
        clock_us=int(getattr(stream, "t_offset_us", 0)),
        end_us=recording.duration_us,
    )
    labels = [label for label in import_labels("sony", file, context).labels if label.state.seen]
    t_us = np.array([label.t_us for label in labels], np.int64)
    uvs = np.array([(label.x_px, label.y_px) for label in labels], np.float64).reshape(-1, 2)
    return find_label_shift(t_us, uvs, times, places)
