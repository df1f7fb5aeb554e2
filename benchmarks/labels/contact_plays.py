"""Contacts proposed in simulated play with balls into the net, against the truth, with and without people in view.

A play is a rally of two players and some balls into the net or over its top edge, which nobody hits. Odd seeds have no
people: the same rally, whose ball turns where a racket would meet it. `--from events` simulates the events of two
cameras of 1280x720 and runs the default detector on them, minutes a play; `--from drawn` draws what a detector finds.
The detections of each play are kept in a file, so that a run which was stopped goes on:

    python -m benchmarks.labels.contact_plays --seed 495000 --plays 20 --from events --kept plays
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.labels.contact_proposals import PRESET, WINDOW_US, detected, seen_around
from core.cameras import Camera
from core.cameras.presets import stereo_preset
from core.events import concatenate_events
from core.files import replacing
from core.metrics.score import binomial_interval
from core.physics import PhysicsConfig
from core.physics.episode import Serves
from core.physics.task import TaskConfig
from core.recordings.recording import FrozenCamera, Triggers
from core.simulation import StereoConfig
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.bodies.rally_flight import HALF_TURN, draw_rally
from core.simulation.episodes.episode_path import NET_STEP_M, rebound_from_wall
from core.simulation.event_cameras.event_camera import simulate_stereo
from core.simulation.flights import FlightSeries, LaunchConfig, ParabolicPath, serve_flight
from core.simulation.scenes.scene import SceneConfig
from core.simulation.truth import ball_truth, pixel_truths, truth_times
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import Proposals, propose
from labels.contacts import contacts_of_truth, match_contacts, score_contacts
from labels.model import ContactLabel

Array = NDArray[np.float64]
NET_BALLS: Final = 3
NET_BALL_S: Final = 0.9
LAST_BOUNCE_S: Final = 0.13
"""A ball that fell from the net is taken away at its first bounce so long after its launch, or so short of the next:
it vanishes slowly, and the bounce before has to be seen on both sides."""
QUIET_S: Final = 0.3
"""Before the first ball, and between two of them: longer than a contact may be hidden."""
COLUMNS: Final = ("t_us", "x_px", "y_px", "r_px", "covariance_px2")
"""Of detections, in the order of `Proposals`."""
APART_US: Final = 10**9
"""Between the clocks of two plays, when they are scored together."""


@dataclass(frozen=True, slots=True)
class PlayContacts:
    """One play: its true contacts, those proposed, and in how many cameras the ball is seen round each true one."""

    seed: int
    people: bool
    truth: tuple[ContactLabel, ...]
    proposed: tuple[ContactLabel, ...]
    seen: tuple[int, ...]


def draw_net_ball(start_s: float, rng: np.random.Generator, physics: PhysicsConfig) -> ParabolicPath:
    """A ball into the net, which falls back, or in half of the draws onto its top edge, which it may pass.

    A ball whose centre is above the edge is pushed along the line from the edge to the centre, and keeps the net's
    restitution along it. That is a choice: nothing is known of balls on a net's tape.
    """
    turn = HALF_TURN if rng.random() < 0.5 else np.ones(3)
    while True:  # a ball that rises steeply enough does not touch the edge
        p = np.array([rng.uniform(0.7, 1.3), rng.uniform(-0.4, 0.4), rng.uniform(0.2, 0.45)])
        heights = (NET_HEIGHT_M, NET_HEIGHT_M + BALL_RADIUS_M) if rng.random() < 0.5 else (0.03, NET_HEIGHT_M)
        met = np.array([0.0, rng.uniform(-0.5, 0.5), rng.uniform(*heights)])
        fly_s = float(np.linalg.norm((met - p)[:2])) / rng.uniform(3.0, 8.0)
        v = (met - p) / fly_s + [0.0, 0.0, 0.5 * GRAVITY_MPS2 * fly_s]
        after = np.array([*met, *v, 0.0, 0.0, 0.0])
        after[5] -= GRAVITY_MPS2 * fly_s
        if met[2] < NET_HEIGHT_M:
            rebound_from_wall(after, TaskConfig(physics=physics))
            break
        rise = (met[2] - NET_HEIGHT_M) / BALL_RADIUS_M
        normal = np.array([np.sqrt(1 - rise**2), 0.0, rise])
        along = float(after[3:6] @ normal)
        if along < 0:
            after[3:6] -= (1 + physics.net_restitution) * along * normal
            after[0] = np.copysign(NET_STEP_M, after[3])
            break
    rest = serve_flight(Serves(after[None, :3], after[None, 3:6], after[None, 6:]), start_s + fly_s, physics)
    assert isinstance(rest, ParabolicPath)
    last = (rest.start_s > start_s + NET_BALL_S) | (np.diff(rest.start_s, append=rest.end_s) < LAST_BOUNCE_S)
    last[0] = False  # the net: a bounce may follow at once
    count = int(np.argmax(last)) if last.any() else len(last)
    end_s = float(rest.start_s[count]) if count < len(last) else rest.end_s
    ps, vs = (np.vstack([first, then[:count]]) * turn for first, then in ((p, rest.p_world_m), (v, rest.v_world_mps)))
    return ParabolicPath(np.append(start_s, rest.start_s[:count]), ps, vs, np.zeros_like(ps), end_s)


def draw_play(seed: int) -> tuple[FlightSeries, MovingBodies | None]:
    """The balls of a play, and the players; none for an odd seed."""
    rng, physics = np.random.default_rng(seed), PhysicsConfig()
    rally, strokes = draw_rally(LaunchConfig(speed_mps=rng.uniform(4.0, 6.0)), QUIET_S, rng, physics)
    flights = [rally]
    for _ in range(NET_BALLS):
        flights.append(draw_net_ball(flights[-1].end_s + QUIET_S, rng, physics))
    return FlightSeries(tuple(flights)), None if seed % 2 else make_actors("rally", seed, strokes)


def detect_play(seed: int, *, events: bool) -> list[Proposals]:
    """What the default detector finds of a play in the events of each camera, or what is drawn in its place."""
    cameras: Mapping[str, Camera] = stereo_preset(PRESET)
    path, bodies = draw_play(seed)
    if not events:
        rng, t_us = np.random.default_rng([seed, 1]), np.arange(0, int(path.end_s * 1e6), WINDOW_US)
        return [detected(truth, rng) for truth in pixel_truths(cameras, path, t_us, bodies).values()]
    config = StereoConfig(scene=SceneConfig(cast="nobody" if bodies is None else "rally"))
    chunks = list(simulate_stereo(config, cameras, path, seed=seed, bodies=bodies))
    no_triggers = Triggers(np.empty(0, np.int64), np.empty(0, np.bool_), np.empty(0, np.int16))
    parts = []
    for name, camera in cameras.items():
        events_of = concatenate_events([chunk.events[name] for chunk in chunks], camera.sensor)
        counts = np.bincount(events_of.t_us // 1000)
        stream = FrozenCamera(name, camera.sensor, camera, None, no_triggers, events_of, counts)
        parts.append(propose(stream, 0, chunks[-1].end_us))
    return parts


def kept_detections(file: Path, seed: int, *, events: bool) -> list[Proposals]:
    """`detect_play`, read from this file if it is there, and else written to it."""
    if not file.exists():
        parts = detect_play(seed, events=events)
        columns = {f"{row}_{name}": getattr(part, name) for row, part in enumerate(parts) for name in COLUMNS}
        with replacing(file, durable=False) as partial, partial.open("wb") as stream:
            np.savez_compressed(stream, detector=parts[0].detector, window_us=parts[0].window_us, **columns)
    with np.load(file) as kept:
        window_us, detector = int(kept["window_us"]), str(kept["detector"])
        parts = []
        for row in range(len(stereo_preset(PRESET))):
            t_us, x, y, r, covariance = (kept[f"{row}_{name}"] for name in COLUMNS)
            parts.append(Proposals(t_us, x, y, r, covariance, window_us, detector))
    return parts


def score_play(seed: int, parts: Sequence[Proposals]) -> PlayContacts:
    """The contacts that are proposed in detections of a play, beside the true ones."""
    cameras: Mapping[str, Camera] = stereo_preset(PRESET)
    path, bodies = draw_play(seed)
    t_us = truth_times(path, 0, int(path.end_s * 1e6))
    truths = pixel_truths(cameras, path, t_us, bodies)
    real = contacts_of_truth(ball_truth(path, t_us))
    seen = tuple(sum(seen_around(truth, one.t_us) for truth in truths.values()) for one in real)
    return PlayContacts(seed, bodies is not None, real, propose_contacts(list(cameras.values()), parts), seen)


def table_of(plays: Sequence[PlayContacts]) -> list[str]:
    """Lines of a Markdown table: recall with its interval, precision and time error, of all contacts and by kind."""
    lines = ["| people | kind | found | recall [95 %] | precision | median | p95 |", "|---|---|---|---|---|---|---|"]
    for name, some in (("no", False), ("yes", True), ("both", None)):
        those = [play for play in plays if some in (None, play.people)]
        found, real = (
            [_moved(one, number * APART_US) for number, play in enumerate(those) for one in getattr(play, side)]
            for side in ("proposed", "truth")
        )
        for row in score_contacts(found, real):
            share = _share(row.matched, row.reference)
            right = f"{row.matched} of {row.found}, {100 * row.precision:.1f} %"
            times = f"{row.time.median_us / 1e3:.2f} ms | {row.time.p95_us / 1e3:.2f} ms"
            lines.append(f"| {name} | {row.kind} | {row.matched} of {row.reference} | {share} | {right} | {times} |")
    return lines


def seen_found(plays: Sequence[PlayContacts], cameras: int = 2) -> tuple[int, int]:
    """How many of the true contacts on both sides of which so many cameras see the ball are proposed, and how many
    there are.
    """
    found = [{b for _, b in match_contacts(play.proposed, play.truth)} for play in plays]
    rows = [
        (b in there, seen >= cameras)
        for play, there in zip(plays, found, strict=True)
        for b, seen in enumerate(play.seen)
    ]
    return sum(one and seen for one, seen in rows), sum(seen for _, seen in rows)


def _share(part: int, whole: int) -> str:
    """A share with its interval; "-" of nothing."""
    if not whole:
        return "-"
    low, high = binomial_interval(part / whole, whole)
    return f"{100 * part / whole:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def _moved(contact: ContactLabel, by_us: int) -> ContactLabel:
    return ContactLabel(t_us=contact.t_us + by_us, kind=contact.kind, sigma_us=contact.sigma_us)


def errors_of(play: PlayContacts) -> list[str]:
    """What was missed, false or of another kind, a line each."""
    pairs = match_contacts(play.proposed, play.truth)
    missed = set(range(len(play.truth))) - {b for _, b in pairs}
    false = set(range(len(play.proposed))) - {a for a, _ in pairs}
    lines = [f"missed {play.truth[b].kind} at {play.truth[b].t_us} us, seen by {play.seen[b]}" for b in sorted(missed)]
    lines += [f"false {play.proposed[a].kind} at {play.proposed[a].t_us} us" for a in sorted(false)]
    other = [(play.proposed[a], play.truth[b]) for a, b in pairs if play.proposed[a].kind is not play.truth[b].kind]
    return lines + [f"{real.kind} at {real.t_us} us called {found.kind}" for found, real in other]


def main() -> None:
    """Print what was missed or false in each play, then the table of all."""
    parser = argparse.ArgumentParser(description="Contacts proposed in simulated play, against the truth.")
    parser.add_argument("--seed", type=int, default=495000, help="of the first play; the next ones count up")
    parser.add_argument("--plays", type=int, default=20)
    parser.add_argument("--from", dest="source", choices=("drawn", "events"), default="drawn", help="detections")
    parser.add_argument("--kept", type=Path, required=True, help="folder of the detections, a file for each play")
    asked = parser.parse_args()
    asked.kept.mkdir(parents=True, exist_ok=True)
    plays = []
    for seed in range(asked.seed, asked.seed + asked.plays):
        file = asked.kept / f"{asked.source}-{seed}.npz"
        plays.append(score_play(seed, kept_detections(file, seed, events=asked.source == "events")))
        print("\n".join([f"seed {seed}", *errors_of(plays[-1])]), flush=True)
    found, true = seen_found(plays)
    print("\n".join([f"{len(plays)} plays", *table_of(plays)]))
    print(f"seen by both cameras on both sides: {found} of {true}, {_share(found, true)}")


if __name__ == "__main__":
    main()
