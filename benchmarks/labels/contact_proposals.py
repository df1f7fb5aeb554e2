"""Contacts proposed in simulated rallies, against the truth: what is found, how many are false, how far times are off.

The ball is where the simulator says that each camera sees it, players in front of it included; what a detector would
find there is drawn: it misses some windows, is a little off, now and then far off, and takes some windows to find a
ball that was hidden. So a rally takes a second, where events and detector take minutes. With `--from events` they are
simulated, and the default detector finds the ball in them, in the same rallies.

    python -m benchmarks.labels.contact_proposals --rallies 24 --seed 3000 --speed 5
    python -m benchmarks.labels.contact_proposals --rallies 1 --seed 4000 --speed 5 --from events
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.cameras import Camera
from core.cameras.presets import stereo_preset
from core.physics import PhysicsConfig
from core.recordings import PixelTruth, open_recording
from core.simulation import StereoConfig, simulate_recording
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.flights import LaunchConfig
from core.simulation.scenes.scene import SceneConfig, scene_named
from core.simulation.truth import ball_truth, pixel_truths, truth_times
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import Proposals, propose
from labels.contacts import MATCH_US, contacts_of_truth, match_contacts
from labels.model import ContactKind, ContactLabel

WINDOW_US = 2_000
SIGMA_PX = 0.3
MISSED, OUTLIERS, OUTLIER_PX = 0.03, 0.01, 10.0
HIDDEN_US, FIND_AGAIN_US = 20_000, 12_000
"""After so long out of sight the ball is found only so much later."""
PRESET = "side"


@dataclass(frozen=True, slots=True, eq=False)
class RallyContacts:
    """One rally: its true contacts, those proposed, and the pairs of rows (proposed, true) that are of one event."""

    truth: tuple[ContactLabel, ...]
    proposed: tuple[ContactLabel, ...]
    pairs: tuple[tuple[int, int], ...]
    seen: tuple[int, ...]
    """Of each true contact, how many cameras see the ball within 40 ms on both sides."""


@dataclass(frozen=True, slots=True)
class ContactFigures:
    """Contacts of one kind over rallies; `kind` "all": any."""

    kind: str
    true: int
    found: int
    """With the right kind."""
    wrong_kind: int
    false: int
    median_ms: float
    p95_ms: float
    hidden_missed: int
    """Those that were not found, and that fewer than two cameras see on both sides."""


def simulate_contacts(seed: int, speed_mps: float = 5.0) -> RallyContacts:
    """A rally of two players at this speed, and what is proposed in drawn detections of its ball."""
    cameras: Mapping[str, Camera] = stereo_preset(PRESET)
    rng, scene = np.random.default_rng(seed), SceneConfig(cast="rally")
    path, strokes = draw_flights(scene, [LaunchConfig(speed_mps=speed_mps)], rng, PhysicsConfig())
    end_us = int(path.end_s * 1e6)
    bodies = make_actors("rally", seed, strokes)
    truths = pixel_truths(cameras, path, np.arange(0, end_us, WINDOW_US), bodies)
    parts = [detected(truth, rng) for truth in truths.values()]
    real = contacts_of_truth(ball_truth(path, truth_times(path, 0, end_us)))
    return _compare(cameras, truths, parts, real)


def simulate_events(seed: int, speed_mps: float, folder: Path) -> RallyContacts:
    """The rally of `simulate_contacts`, and what is proposed in its events by the default detector.

    `folder`: for the recording, of some 100 MB, which is deleted.
    """
    cameras: Mapping[str, Camera] = stereo_preset(PRESET)
    config, path = StereoConfig(scene=scene_named("rally")), folder / f"{seed}.h5"
    simulate_recording(path, config, cameras, [LaunchConfig(speed_mps=speed_mps)], seed=seed)
    with open_recording(path) as recording:
        streams = recording.cameras
        truths = {name: stream.truth for name, stream in streams.items() if stream.truth is not None}
        assert recording.ball is not None and truths.keys() == cameras.keys()
        parts = [propose(streams[name], 0, recording.duration_us) for name in cameras]
        found = _compare(cameras, truths, parts, contacts_of_truth(recording.ball))
    path.unlink()
    return found


def _compare(
    cameras: Mapping[str, Camera],
    truths: Mapping[str, PixelTruth],
    parts: Sequence[Proposals],
    real: tuple[ContactLabel, ...],
) -> RallyContacts:
    """What is proposed in what was found in each camera, beside the true contacts."""
    proposed = propose_contacts(list(cameras.values()), parts)
    seen = tuple(sum(seen_around(truth, one.t_us) for truth in truths.values()) for one in real)
    return RallyContacts(real, proposed, match_contacts(proposed, real, MATCH_US), seen)


def detected(truth: PixelTruth, rng: np.random.Generator) -> Proposals:
    """What a detector finds of a ball that is seen so."""
    seen_us = truth.t_us[truth.visible]
    again_us = seen_us[np.diff(seen_us, prepend=seen_us[:1] - 10 * HIDDEN_US) > HIDDEN_US]
    since_us = truth.t_us - again_us[np.maximum(np.searchsorted(again_us, truth.t_us, "right") - 1, 0)]
    kept = truth.visible & (since_us >= FIND_AGAIN_US) & (rng.random(len(truth.t_us)) > MISSED)
    count = int(kept.sum())
    off = rng.normal(0, SIGMA_PX, (count, 2)) + rng.normal(0, OUTLIER_PX, (count, 2)) * (
        rng.random((count, 1)) < OUTLIERS
    )
    x, y = truth.u_px[kept] + off[:, 0], truth.v_px[kept] + off[:, 1]
    return Proposals(truth.t_us[kept], x, y, truth.r_px[kept], np.full((count, 3), np.nan), WINDOW_US, "drawn#1")


def seen_around(truth: PixelTruth, t_us: int) -> bool:
    """Whether the ball is seen in more than half of the 40 ms before, and after."""
    sides = ((truth.t_us >= t_us - 40_000) & (truth.t_us < t_us), (truth.t_us > t_us) & (truth.t_us <= t_us + 40_000))
    return all(truth.visible[side].sum() > side.sum() / 2 for side in sides)


def figures_of(rallies: Sequence[RallyContacts]) -> tuple[ContactFigures, ...]:
    """Figures of all contacts, then of each kind that occurs."""
    kinds = [kind for kind in ContactKind if any(one.kind is kind for rally in rallies for one in rally.truth)]
    return tuple(_figures(rallies, kind) for kind in (None, *kinds))


def _figures(rallies: Sequence[RallyContacts], kind: ContactKind | None) -> ContactFigures:
    true = found = wrong = false = hidden = 0
    late_ms: list[float] = []
    for rally in rallies:
        partner = {b: rally.proposed[a] for a, b in rally.pairs}
        unpaired = set(range(len(rally.proposed))) - {a for a, _ in rally.pairs}
        false += sum(kind in (None, rally.proposed[row].kind) for row in unpaired)
        for row, real in enumerate(rally.truth):
            if kind not in (None, real.kind):
                continue
            true += 1
            other = partner.get(row)
            if other is None:
                hidden += rally.seen[row] < 2
                continue
            found, wrong = found + (other.kind is real.kind), wrong + (other.kind is not real.kind)
            late_ms.append(abs(other.t_us - real.t_us) / 1e3)
    median, p95 = np.percentile(late_ms, (50, 95)).tolist() if late_ms else (float("nan"),) * 2
    return ContactFigures(str(kind or "all"), true, found, wrong, false, median, p95, hidden)


def main() -> None:
    """Print the figures of some rallies."""
    parser = argparse.ArgumentParser(description="Contacts proposed in simulated rallies, against the truth.")
    parser.add_argument("--rallies", type=int, default=24)
    parser.add_argument("--seed", type=int, default=3000, help="of the first rally; the next ones count up")
    parser.add_argument("--speed", type=float, default=5.0, help="m/s")
    parser.add_argument("--from", dest="source", choices=("drawn", "events"), default="drawn", help="detections")
    asked = parser.parse_args()
    seeds = range(asked.seed, asked.seed + asked.rallies)
    if asked.source == "drawn":
        rallies = [simulate_contacts(seed, asked.speed) for seed in seeds]
    else:
        with tempfile.TemporaryDirectory() as folder:
            rallies = [simulate_events(seed, asked.speed, Path(folder)) for seed in seeds]
    print("kind     true found wrong kind false  median ms  p95 ms  hidden and missed")
    for row in figures_of(rallies):
        counts = f"{row.kind:8} {row.true:4} {row.found:5} {row.wrong_kind:10} {row.false:5}"
        print(f"{counts} {row.median_ms:10.3f} {row.p95_ms:7.3f} {row.hidden_missed:18}")


if __name__ == "__main__":
    main()
