"""What n cameras saw of one moving body: a ball, a wand with markers, or a board, at common instants.

Cameras do not look at the same moment. A sighting is moved to the asked time along its own motion in the picture, by
3 ms at most, so that clocks can be shifted against each other and no noise is averaged away.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.point_track import LARGEST_FILE_BYTES, PointTrack, clean_track, motion_directions
from core.errors import CalibrationError

Array = NDArray[np.float64]

DENSE_US: Final = 6000
"""A track whose sightings follow each other faster can be cleaned by its neighbours."""
FARTHEST_US: Final = 3000.0
"""A sighting is moved along its motion by so much at most."""
STILL_US: Final = 100.0
"""The same where its motion is unknown: 0.1 mm at 1 m/s."""
NEIGHBOUR_US: Final = 40_000.0
"""Motion is read from neighbours that are nearer than this."""
TABLE_COLUMNS: Final = "camera,time,x,y (seconds, pixels; also t_us,u_px,v_px) and, if known, sigma and marker"


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What C cameras saw at G instants of a body with K points."""

    uvs_px: Array
    """(G, K, C, 2), nan where a point was not seen."""
    speeds: Array
    """(G, K, C, 2) motion in the picture, px/us."""
    directions: Array
    """(G, K, C, 2) unit vectors along that motion; 0 where there is none."""
    sigmas: Array
    """(G, K, C) of a sighting, relative to the others; 1 where the source does not say."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyTracks:
    """The tracks of C cameras, and the body whose points they are."""

    tracks: tuple[PointTrack, ...]
    sigmas: tuple[Array, ...]
    """(N,) per camera and sighting, relative."""
    body_m: Array
    """(K, 3): places of the markers 0, 1, ... on the body; a single 0 for a ball."""
    middle_us: float
    """From which drifts are counted."""

    def sample(self, t_us: Array, offsets_us: Array, drifts_ppm: Array) -> Samples:
        """What each camera saw at common times (G,); its clock is ahead by its offset, and faster by its drift."""
        shape = (len(t_us), len(self.body_m), len(self.tracks))
        samples = Samples(np.full((*shape, 2), np.nan), np.zeros((*shape, 2)), np.zeros((*shape, 2)), np.ones(shape))
        for c, track in enumerate(self.tracks):
            at_us = t_us + offsets_us[c] + 1e-6 * drifts_ppm[c] * (t_us - self.middle_us)
            speeds, directions = _speeds(track), motion_directions(track)
            for k in range(len(self.body_m)):
                rows = np.flatnonzero(track.marker == k)
                if not len(rows):
                    continue
                row = rows[_nearest(track.t_us[rows], at_us)]
                step_us = at_us - track.t_us[row]
                known = np.isfinite(speeds[row, 0])
                near = np.abs(step_us) <= np.where(known, FARTHEST_US, STILL_US)
                speed = np.nan_to_num(speeds[row])
                samples.uvs_px[near, k, c] = (track.uvs_px[row] + speed * step_us[:, None])[near]
                samples.speeds[:, k, c] = speed
                samples.directions[:, k, c] = directions[row]
                samples.sigmas[:, k, c] = self.sigmas[c][row]
        return samples

    def instants(self, offsets_us: Array, drifts_ppm: Array) -> Array:
        """(G,) common times at which any camera saw something, half an interval of the fastest apart or more."""
        steps = [np.diff(np.unique(track.t_us)) for track in self.tracks]
        apart_us = 0.5 * min((float(np.median(step)) for step in steps if len(step)), default=1.0)
        every = [
            track.t_us - offset - 1e-6 * drift * (track.t_us - self.middle_us)
            for track, offset, drift in zip(self.tracks, offsets_us, drifts_ppm, strict=True)
        ]
        chosen: list[float] = []
        for t in np.unique(np.concatenate(every)).tolist():
            if not chosen or t - chosen[-1] > apart_us:
                chosen.append(t)
        return np.array(chosen)


def body_tracks(
    tracks: Sequence[PointTrack], body_m: Array, sigmas: Sequence[Array] | None = None, *, clean: bool = True
) -> BodyTracks:
    """The tracks of all cameras; of dense ones, strays that the neighbours do not expect are left out."""
    given = sigmas or [np.ones(len(track.t_us)) for track in tracks]
    kept, weights = [], []
    for track, sigma in zip(tracks, given, strict=True):
        step = np.diff(track.t_us)[np.diff(track.marker) == 0]
        dense = clean and len(step) > 0 and float(np.median(step)) <= DENSE_US
        left = clean_track(track) if dense else track
        key, order = track.t_us * 128 + track.marker, np.argsort(track.t_us * 128 + track.marker, kind="stable")
        kept.append(left)
        weights.append(sigma[order][np.searchsorted(key[order], left.t_us * 128 + left.marker)])
    every = np.concatenate([track.t_us for track in kept])
    middle_us = float(np.median(every)) if len(every) else 0.0
    return BodyTracks(tuple(kept), tuple(weights), np.asarray(body_m, np.float64).reshape(-1, 3), middle_us)


def moved_pixels(tracks: BodyTracks, shifts: Sequence[tuple[Array, Array]]) -> BodyTracks:
    """The tracks with pixels shifted by (N, 2) at times (N,) of each camera's clock, linear between them."""
    moved = []
    for track, (t_us, shift) in zip(tracks.tracks, shifts, strict=True):
        if len(t_us):
            by = np.column_stack([np.interp(track.t_us, t_us, column) for column in shift.T])
            track = replace(track, uvs_px=track.uvs_px + by)
        moved.append(track)
    return replace(tracks, tracks=tuple(moved))


def _nearest(t_us: NDArray[np.int64], at_us: Array) -> NDArray[np.intp]:
    """(M,) rows of the ascending times (N,) that are nearest."""
    after = np.clip(np.searchsorted(t_us, at_us), 1, max(len(t_us) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(t_us) - 1)
    return np.where(np.abs(t_us[after] - at_us) < np.abs(at_us - t_us[before]), after, before)


def _speeds(track: PointTrack) -> Array:
    """(N, 2) px/us from the neighbours before and after; nan without both."""
    speeds = np.full((len(track.t_us), 2), np.nan)
    if len(track.t_us) < 3:
        return speeds
    span = (track.t_us[2:] - track.t_us[:-2]).astype(np.float64)
    good = (track.marker[2:] == track.marker[:-2]) & (span > 0) & (span <= 2 * NEIGHBOUR_US)
    move = track.uvs_px[2:] - track.uvs_px[:-2]
    speeds[1:-1][good] = move[good] / span[good, None]
    return speeds


def read_points_table(path: Path) -> tuple[dict[str, PointTrack], dict[str, Array]]:
    """A table of 2D points, one a row: the tracks by camera, and the standard deviations of their sightings, px.

    Columns: camera; time or t_s (seconds) or t_us; x or u_px; y or v_px; if known sigma or sigma_px, and marker (0, 1,
    ... along a wand).

    Raises:
        CalibrationError: if it is no such table.
    """
    found: dict[str, list[tuple[float, ...]]] = {}
    try:
        if path.stat().st_size > LARGEST_FILE_BYTES:
            raise CalibrationError("too large for a table of points", expected="at most 256 MiB", where=path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            for number, row in enumerate(csv.DictReader(file), start=2):
                name, values = _point(row, f"{path}, line {number}")
                found.setdefault(name, []).append(values)
    except OSError as error:
        raise CalibrationError("cannot read the points", got=error.strerror, where=path) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError("not a table", expected=f"CSV with {TABLE_COLUMNS}", where=path) from error
    tracks, sigmas = {}, {}
    for name, rows in found.items():
        columns = np.array(rows, np.float64)
        columns = columns[np.lexsort((columns[:, 0], columns[:, 4]))]
        tracks[name] = PointTrack.of(columns[:, 0].round(), columns[:, 1:3], columns[:, 4])
        sigmas[name] = columns[:, 3]
    return tracks, sigmas


def _point(row: Mapping[str, str | None], where: str) -> tuple[str, tuple[float, ...]]:
    def value(names: Sequence[str], default: float | None = None) -> float:
        text = next((row[name] for name in names if row.get(name)), None)
        if text is None and default is not None:
            return default
        return float(text or "")

    try:
        in_us = bool(row.get("t_us"))
        t_us = value(("t_us",)) if in_us else 1e6 * value(("t_s", "time"))
        u_px, v_px = value(("u_px", "x")), value(("v_px", "y"))
        sigma, marker = value(("sigma_px", "sigma"), 1.0), value(("marker",), 0.0)
    except ValueError as error:
        raise CalibrationError("not a point", expected=TABLE_COLUMNS, where=where) from error
    name = row.get("camera")
    whole = all(map(math.isfinite, (t_us, u_px, v_px, sigma))) and abs(t_us) < 2**53 and sigma > 0
    if not name or not whole or not (0 <= marker < 100 and marker % 1 == 0):
        expected = "a camera, finite numbers, a sigma above 0, a marker 0 to 99"
        raise CalibrationError("not a point", expected=expected, where=where)
    return name, (t_us, u_px, v_px, sigma, marker)
