"""A first guess of n cameras: pairs that saw the same things, chained along a spanning tree from the best pair.

How two cameras stand to each other and how far their clocks are apart: for each of many time offsets the essential
matrix is estimated (OpenCV, RANSAC) from what both would have seen at one time; the offset at which the most sightings
agree is taken. The translation has length 1: two views know no scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.body_tracks import BodyTracks
from core.cameras.calibration.bundle import Rig
from core.cameras.calibration.triangulation import points_of
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import invert_transform, make_transform

Array = NDArray[np.float64]

POINTS_AT_LEAST: Final = 30
SEARCH_POINTS: Final = 300
SEARCH_ROUNDS: Final = 60
"""Rounds of RANSAC at each offset; at the best one it goes on."""
ROUNDS: Final = 2000
FLAT_SHARE: Final = 0.9
"""Share of the sightings; when so many are on one plane (a homography explains them) a mirrored pose fits as well."""
THRESHOLD_PX: Final = 3.0
"""Distance from the epipolar line of a sighting that agrees, wide because the offset is searched in steps."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """The second camera in the first one's frame."""

    T_first_second: Array
    """(4, 4), the translation of length 1."""
    offset_us: float
    """The second camera's clock minus the first one's."""
    agreeing: float
    """Share of the sightings on their epipolar lines."""


def guess_relative_pose(
    first: Array,
    second_at: Callable[[float], Array],
    offsets_us: Array,
    focal_px: float,
    *,
    progress: Callable[[float], None] = lambda share: None,
) -> RelativePose:
    """The best guess over the offsets (K,), from pinhole coordinates (N, 2) of the first camera.

    `second_at(offset_us)` gives those of the second (N, 2) if its clock is ahead by so much; nan: not seen.

    Args:
        first: (N, 2) pinhole coordinates of the first camera.
        second_at: those of the second camera for an offset of its clock, us.
        offsets_us: (K,) offsets that are tried.
        focal_px: scale of the tolerance: what a pinhole coordinate of 1 is in pixels.
        progress: gets the share that is done.

    Raises:
        CalibrationError: if the two saw too little at the same time, or nothing agrees.
    """
    best: tuple[float, float] | None = None
    most_common = 0
    for number, offset_us in enumerate(offsets_us.tolist()):
        second = second_at(offset_us)
        common = np.flatnonzero(np.isfinite(first[:, 0]) & np.isfinite(second[:, 0]))
        most_common = max(most_common, len(common))
        if len(common) >= POINTS_AT_LEAST:
            # Few points to compare the offsets; the best one gets them all.
            chosen = common[np.linspace(0, len(common) - 1, min(len(common), SEARCH_POINTS)).astype(int)]
            E = _essential(first[chosen], second[chosen], focal_px, SEARCH_ROUNDS)
            score = 0.0 if E is None else _agreement(E, first[chosen], second[chosen], focal_px)
            if best is None or score > best[0]:
                best = score, offset_us
        progress((number + 1) / len(offsets_us))
    if best is None:
        raise CalibrationError(
            "the cameras saw too little at the same time",
            expected=f"{POINTS_AT_LEAST} common sightings or more",
            got=most_common,
            remedy="sweep the ball where both see it; --max-offset-ms must exceed the clocks' difference",
        )
    score, offset_us = best
    second = second_at(offset_us)
    common = np.isfinite(first[:, 0]) & np.isfinite(second[:, 0])
    return _refined(first[common], second[common], focal_px, offset_us, score)


def _essential(first: Array, second: Array, focal_px: float, rounds: int) -> Array | None:
    cv2.setRNGSeed(0)  # the same sightings, the same answer
    threshold = THRESHOLD_PX / focal_px
    E, _ = cv2.findEssentialMat(
        first, second, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=threshold, maxIters=rounds
    )
    return None if E is None or np.shape(E) != (3, 3) else np.asarray(E, np.float64)


def _agreement(E: Array, first: Array, second: Array, focal_px: float) -> float:
    """Mean over the points of 1 on the epipolar line, falling to 0 at the threshold (MSAC)."""
    squared = (sampson_distance(E, first, second) * focal_px / THRESHOLD_PX) ** 2
    return float(np.maximum(0.0, 1.0 - squared).mean())


def sampson_distance(E: Array, first: Array, second: Array) -> Array:
    """(N,) first-order distance of pairs of pinhole coordinates from the epipolar geometry."""
    ones = np.ones((len(first), 1))
    a, b = np.hstack([first, ones]), np.hstack([second, ones])
    lines_b, lines_a = a @ E.T, b @ E
    across = np.einsum("ij,ij->i", b, lines_b)
    return np.abs(across) / np.sqrt((lines_b[:, :2] ** 2).sum(axis=1) + (lines_a[:, :2] ** 2).sum(axis=1))


def _refined(first: Array, second: Array, focal_px: float, offset_us: float, score: float) -> RelativePose:
    chosen = np.linspace(0, len(first) - 1, min(len(first), 4 * SEARCH_POINTS)).astype(int)
    E = _essential(first[chosen], second[chosen], focal_px, ROUNDS)
    _, on_plane = cv2.findHomography(first[chosen], second[chosen], cv2.RANSAC, THRESHOLD_PX / focal_px)
    remedy = "sweep the ball through the whole volume, in all directions"
    if on_plane is not None and np.mean(on_plane) > FLAT_SHARE:
        raise CalibrationError("the ball was seen in one plane only, which fits two poses", remedy=remedy)
    if E is None:
        raise CalibrationError("the sightings fix no pose", remedy=remedy)
    _, R, t, in_front = cv2.recoverPose(E, first, second, np.eye(3))
    if np.count_nonzero(in_front) < 0.5 * len(first):
        raise CalibrationError("no pose puts the ball in front of both cameras", remedy=remedy)
    R = np.asarray(R, np.float64)
    return RelativePose(make_transform(R.T, -R.T @ np.ravel(t)), offset_us, score)


Progress = Callable[[float], None]

CHAINED_AT_LEAST: Final = 10
"""Points that two pairs have in common, so that one scale holds for both."""
WAND_SIGHTINGS: Final = 20
"""Lengths of a wand that give a pair its scale."""
SEARCH_INSTANTS: Final = 20_000
"""At most so many are looked at for each offset of the clocks."""
SHARED_INSTANTS: Final = 4000
"""At most so many are looked at to count what cameras share."""


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """How the second of two cameras stands to the first one; lengths in metres or, of a ball, in units of its own."""

    T_first_second: Array
    offset_us: float
    """The second one's clock minus the first one's."""
    in_metres: bool


def shared_points(tracks: BodyTracks) -> NDArray[np.int64]:
    """(C, C) how many sightings each two cameras share, clocks taken as equal; its own on the diagonal."""
    zeros = np.zeros(len(tracks.tracks))
    t_us = tracks.instants(zeros, zeros)
    chosen = np.linspace(0, len(t_us) - 1, min(len(t_us), SHARED_INSTANTS)).astype(int)
    seen = np.isfinite(tracks.sample(t_us[chosen], zeros, zeros).uvs_px[..., 0]).reshape(-1, len(zeros)).astype(float)
    return np.rint(seen.T @ seen * len(t_us) / max(len(chosen), 1)).astype(np.int64)


def guess_rig(
    tracks: BodyTracks,
    lenses: Sequence[Camera],
    offsets_us: Array,
    progress: Progress = lambda share: None,
) -> Rig:
    """All cameras in the first one's frame, the clocks of two as far apart as one of `offsets_us`.

    In metres where the body has a size; of a ball in units of the baseline of the pair that shares most.

    Args:
        tracks: what each camera saw of the body, px.
        lenses: of the cameras in the same order; their poses are not looked at.
        offsets_us: (K,) offsets between two clocks that are tried.
        progress: gets the share that is done.

    Raises:
        CalibrationError: if a camera shares too little with the others; it is named, and what to sweep.
    """
    names, shared = tracks.names, shared_points(tracks)
    pairs = shared - np.diag(np.diag(shared))
    Ts: dict[int, Array] = {int(np.unravel_index(np.argmax(pairs), pairs.shape)[0]): np.eye(4)}
    clocks = dict.fromkeys(Ts, 0.0)
    while len(Ts) < len(names):
        # Pairs that seem to share nothing come last, but they are tried: their clocks may be far apart.
        best = sorted(((pairs[a, b], a, b) for a in Ts for b in range(len(names)) if b not in Ts), reverse=True)
        problem: CalibrationError | None = None

        def show(share: float) -> None:
            progress((len(Ts) - 1 + share) / (len(names) - 1))

        for _, a, b in best:
            try:
                edge = _edge(tracks, lenses, a, b, offsets_us, show)
                factor = 1.0 if edge.in_metres or len(Ts) == 1 else _scale(tracks, lenses, Ts, clocks, a, b, edge)
            except CalibrationError as error:
                problem = problem or error
                continue
            T = make_transform(edge.T_first_second[:3, :3], factor * edge.T_first_second[:3, 3])
            Ts[b], clocks[b] = Ts[a] @ T, clocks[a] + edge.offset_us
            break
        else:
            assert problem is not None
            if len(names) == 2:
                raise problem
            if best[0][0] < POINTS_AT_LEAST:
                raise _too_little(names, shared, set(Ts)) from problem
            raise CalibrationError(f"{names[best[0][2]]} cannot be placed: {problem}") from problem
    T_first = invert_transform(Ts[0])
    cameras = tuple(replace(lens, T_world_camera=T_first @ Ts[c]) for c, lens in enumerate(lenses))
    rig = Rig(cameras, np.array([clocks[c] - clocks[0] for c in range(len(names))]), np.zeros(len(names)))
    return rig if len(tracks.body_m) > 1 else scaled_rig(rig, 1.0 / rig.baseline)


def scaled_rig(rig: Rig, factor: float, R_world_frame: Array | None = None) -> Rig:
    """The rig with all lengths times a factor, in a turned frame."""
    R = np.eye(3) if R_world_frame is None else R_world_frame
    Ts = [camera.T_world_camera for camera in rig.cameras]
    turned = [make_transform(R @ T[:3, :3], factor * R @ T[:3, 3]) for T in Ts]
    cameras = tuple(replace(camera, T_world_camera=T) for camera, T in zip(rig.cameras, turned, strict=True))
    return replace(rig, cameras=cameras)


def _too_little(names: Sequence[str], shared: NDArray[np.int64], placed: set[int]) -> CalibrationError:
    """Names the cameras that are cut off, how much each shares with whom, and what to sweep."""
    alone = [c for c in range(len(names)) if c not in placed]
    if len(placed) == 1:  # nobody shares anything with anybody
        alone = list(range(len(names)))
    worst = max(alone, key=lambda c: shared[c, list(placed - {c})].max(initial=0))
    others = sorted((c for c in range(len(names)) if c != worst), key=lambda c: -int(shared[worst, c]))
    counts = ", ".join(f"{shared[worst, c]} with {names[c]}" for c in others)
    partner = next((c for c in others if c in placed), others[0])
    return CalibrationError(
        f"{names[worst]} shares too little with the rest",
        expected=f"{POINTS_AT_LEAST} common sightings or more with a camera of the rest",
        got=f"{shared[worst, worst]} of its own, {counts}",
        remedy=f"sweep the ball where {names[worst]} and {names[partner]} both see it",
    )


def _edge(tracks: BodyTracks, lenses: Sequence[Camera], a: int, b: int, offsets_us: Array, progress: Progress) -> Edge:
    """Two cameras by their common sightings; for a board by its poses before each."""
    one, other = (replace(tracks, tracks=(tracks.tracks[c],), sigmas=(tracks.sigmas[c],)) for c in (a, b))
    zeros = np.zeros(1)
    t_us = one.instants(zeros, zeros)
    t_us = t_us[np.linspace(0, len(t_us) - 1, min(len(t_us), SEARCH_INSTANTS)).astype(int)]
    body_rank = np.linalg.matrix_rank(tracks.body_m - tracks.body_m[0], tol=1e-9)

    def seen_by(c: int, track: BodyTracks, offset_us: float) -> Array:
        return lenses[c].undistort(track.sample(t_us, np.array([offset_us]), zeros).uvs_px.reshape(-1, 2))

    first = seen_by(a, one, 0.0)

    def seen_at(offset_us: float) -> Array:
        return np.stack([first, seen_by(b, other, offset_us)], axis=1)

    if body_rank > 1:
        return Edge(_by_boards(tracks.body_m, seen_at(0.0).reshape(len(t_us), -1, 2, 2)), 0.0, True)
    focal = float(np.mean([np.diag(lenses[c].K)[:2] for c in (a, b)]))
    pose = guess_relative_pose(
        first, lambda offset_us: seen_by(b, other, offset_us), offsets_us, focal, progress=progress
    )
    if body_rank == 0:
        return Edge(pose.T_first_second, pose.offset_us, False)
    there = _points(pose.T_first_second, seen_at(pose.offset_us), focal).reshape(len(t_us), -1, 3)
    lengths = np.linalg.norm(there[:, 1:] - there[:, :1], axis=2)
    true = np.linalg.norm(tracks.body_m[1:] - tracks.body_m[0], axis=1)
    ratios = (true / lengths)[np.isfinite(lengths)]
    if len(ratios) < WAND_SIGHTINGS:
        expected = f"{WAND_SIGHTINGS} distances between its markers, each seen by both cameras at one time"
        raise CalibrationError("too little of the wand", expected=expected, got=len(ratios))
    # Two pictures leave the scale open; the wand's lengths give it. The median: a wrong match does not matter.
    T = make_transform(pose.T_first_second[:3, :3], float(np.median(ratios)) * pose.T_first_second[:3, 3])
    return Edge(T, pose.offset_us, True)


def _points(T_first_second: Array, xys: Array, focal_px: float) -> Array:
    """(N, 3) in the first camera's frame."""
    return points_of(np.stack([np.eye(4), T_first_second]), xys, np.full(2, focal_px))


def _scale(
    tracks: BodyTracks,
    lenses: Sequence[Camera],
    Ts: Mapping[int, Array],
    clocks: Mapping[int, float],
    a: int,
    b: int,
    edge: Edge,
) -> float:
    """By how much an edge of length 1 is to be stretched: depths in camera `a` by it and by the placed cameras."""
    placed = sorted(Ts)
    offsets = np.array([clocks[c] for c in placed] + [clocks[a] + edge.offset_us])
    chosen = [*placed, b]
    some = replace(
        tracks, tracks=tuple(tracks.tracks[c] for c in chosen), sigmas=tuple(tracks.sigmas[c] for c in chosen)
    )
    t_us = some.instants(offsets, np.zeros(len(chosen)))
    uvs = some.sample(t_us, offsets, np.zeros(len(chosen))).uvs_px.reshape(-1, len(chosen), 2)
    xys = np.stack([lenses[c].undistort(uvs[:, k]) for k, c in enumerate(chosen)], axis=1)
    poses = np.stack([invert_transform(Ts[a]) @ Ts[c] for c in placed])
    focals = np.array([lenses[c].K[0, 0] for c in chosen])
    known = points_of(poses, xys[:, :-1], focals[:-1])
    unit = _points(edge.T_first_second, xys[:, [placed.index(a), -1]], float(focals.mean()))
    ratios = (known[:, 2] / unit[:, 2])[np.isfinite(known[:, 2] * unit[:, 2])]
    # A point behind the camera is a wrong match.
    ratios = ratios[ratios > 0]
    if len(ratios) < CHAINED_AT_LEAST:
        remedy = "sweep the ball where it and two of the others see it at once, or sweep a wand"
        expected = f"{CHAINED_AT_LEAST} points that three cameras see at once"
        raise CalibrationError("its distance is open", expected=expected, got=len(ratios), remedy=remedy)
    return float(np.median(ratios))


def _by_boards(body_m: Array, xys: Array) -> Array:
    """`T_first_second` (4, 4): of the common pictures (G, K, 2, 2) that whose answer lies in the middle of all."""
    found = []
    for picture in xys[np.isfinite(xys).all(axis=(1, 2, 3))]:
        poses = []
        for side in (0, 1):
            _, rvec, tvec = cv2.solvePnP(body_m, np.ascontiguousarray(picture[:, side]), np.eye(3), np.zeros(5))
            poses.append(make_transform(cv2.Rodrigues(rvec)[0], np.ravel(tvec)))
        found.append(poses[0] @ invert_transform(poses[1]))
    if not found:
        raise CalibrationError("no picture in which both see the whole board", remedy="show the board to both at once")
    Ts = np.stack(found)
    apart = np.linalg.norm(Ts[:, None, :3, 3] - Ts[None, :, :3, 3], axis=2)
    apart += np.linalg.norm(Ts[:, None, :3, :3] - Ts[None, :, :3, :3], axis=(2, 3)) * apart.max(initial=1.0)
    return Ts[int(np.argmin(np.median(apart, axis=1)))]
