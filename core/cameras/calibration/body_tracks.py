"""What n cameras saw of one moving body: a ball, a wand with markers, or a board, at common instants.

Cameras do not look at the same moment. The sighting nearest to the asked time is moved there along the parabola through
it and its two neighbours, so that clocks can be shifted against each other and no noise is averaged away.
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
"""A sighting is moved along its motion by so much, or by half the interval to its neighbours if that is more."""
STILL_US: Final = 100.0
"""The same where its motion is unknown: 0.1 mm at 1 m/s."""
NEIGHBOUR_US: Final = 120_000.0
"""Motion is read from neighbours that are nearer than this: cameras of 10 pictures/s are enough for a slow wand."""
GOLDEN: Final = (math.sqrt(5) - 1) / 2
"""Its multiples, less their whole parts, fill an interval evenly, however many there are."""
TABLE_COLUMNS: Final = "camera,time,x,y (seconds, pixels; also t_us,u_px,v_px) and, if known, sigma and marker"


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What C cameras saw at G instants of a body with K points, by given clocks."""

    body_m: Array
    """(K, 3) places of the points on the body."""
    t_us: Array
    """(G,) common times."""
    since_us: Array
    """(G,) the same from the time on from which drifts are counted."""
    offsets_us: Array
    """(C,) a camera's clock minus the common one."""
    drifts_ppm: Array
    """(C,)."""
    uvs_px: Array
    """(G, K, C, 2), nan where a point was not seen."""
    speeds: Array
    """(G, K, C, 2) motion in the picture, px/us."""
    growths: Array
    """(G, K, C, 2) half the acceleration in the picture, px/us^2."""
    directions: Array
    """(G, K, C, 2) unit vectors along the motion; 0 where there is none."""
    sigmas: Array
    """(G, K, C) of a sighting, relative to the others; 1 where the source does not say."""

    def by_clocks(self, offsets_us: Array, drifts_ppm: Array) -> Samples:
        """These sightings by other clocks: none comes or goes, so that a fit cannot get rid of them."""
        step = (offsets_us - self.offsets_us) + 1e-6 * np.outer(self.since_us, drifts_ppm - self.drifts_ppm)
        if not step.any():
            return self
        by = step[:, None, :, None]
        places, speeds = self.uvs_px + by * (self.speeds + by * self.growths), self.speeds + 2 * by * self.growths
        return replace(self, offsets_us=offsets_us, drifts_ppm=drifts_ppm, uvs_px=places, speeds=speeds)

    def each_on_its_own(self) -> Samples:
        """The M markers as so many points that nothing ties to each other: (G * M, 1, C), times repeated."""
        count = self.uvs_px.shape[1]
        names = ("uvs_px", "speeds", "growths", "directions", "sigmas")
        flat = {name: getattr(self, name).reshape(-1, 1, *getattr(self, name).shape[2:]) for name in names}
        return replace(self, t_us=np.repeat(self.t_us, count), since_us=np.repeat(self.since_us, count), **flat)


@dataclass(frozen=True, slots=True, eq=False)
class BodyTracks:
    """The tracks of C cameras, and the body whose points they are."""

    names: tuple[str, ...]
    tracks: tuple[PointTrack, ...]
    sigmas: tuple[Array, ...]
    """(N,) per camera and sighting, relative."""
    body_m: Array
    """(K, 3): places of the markers 0, 1, ... on the body; a single 0 for a ball, or for markers on a wand whose places
    are not known: each of them is a point of its own."""
    markers: int
    """How many there are: K, or those of a wand whose places are not known."""
    middle_us: float
    """From which drifts are counted."""

    def sample(self, t_us: Array, offsets_us: Array, drifts_ppm: Array) -> Samples:
        """What each camera saw at common times (G,); its clock is ahead by its offset, and faster by its drift."""
        shape = (len(t_us), self.markers, len(self.tracks))
        uvs, speeds, growths, directions = (np.full((*shape, 2), fill) for fill in (np.nan, 0.0, 0.0, 0.0))
        sigmas = np.ones(shape)
        for c, track in enumerate(self.tracks):
            at_us = t_us + offsets_us[c] + 1e-6 * drifts_ppm[c] * (t_us - self.middle_us)
            motion, ahead = _motion(track), motion_directions(track)
            for k in range(self.markers):
                rows = np.flatnonzero(track.marker == k)
                if not len(rows):
                    continue
                row = rows[_nearest(track.t_us[rows], at_us)]
                step_us = (at_us - track.t_us[row])[:, None]
                speed, growth, span_us = motion[row, :2], motion[row, 2:4], motion[row, 4]
                near = np.abs(step_us[:, 0]) <= np.where(span_us > 0, np.maximum(FARTHEST_US, span_us / 4), STILL_US)
                places = track.uvs_px[row] + step_us * (speed + step_us * growth)
                uvs[near, k, c], speeds[:, k, c] = places[near], speed + 2 * step_us * growth
                growths[:, k, c], directions[:, k, c], sigmas[:, k, c] = growth, ahead[row], self.sigmas[c][row]
        since_us = t_us - self.middle_us
        clocks = (np.asarray(offsets_us, np.float64), np.asarray(drifts_ppm, np.float64))
        samples = Samples(self.body_m, t_us, since_us, *clocks, uvs, speeds, growths, directions, sigmas)
        return samples if len(self.body_m) > 1 else samples.each_on_its_own()

    @property
    def interval_us(self) -> float:
        """Time between sightings of the fastest camera."""
        steps = [np.diff(np.unique(track.t_us)) for track in self.tracks]
        return min((float(np.median(step)) for step in steps if len(step)), default=2.0)

    def instants(self, offsets_us: Array, drifts_ppm: Array) -> Array:
        """(G,) common times at which any camera saw something, half an interval of the fastest apart or more."""
        apart_us = 0.5 * self.interval_us
        every = [
            track.t_us - offset - 1e-6 * drift * (track.t_us - self.middle_us)
            for track, offset, drift in zip(self.tracks, offsets_us, drifts_ppm, strict=True)
        ]
        chosen: list[float] = []
        for t in np.unique(np.concatenate(every)).tolist():
            if not chosen or t - chosen[-1] > apart_us:
                chosen.append(t)
        return np.array(chosen)

    def spread_instants(self, t_us: Array) -> Array:
        """The times (G,) moved by up to half an interval between sightings, each by another share of it.

        A sighting that is moved to the middle between two carries less noise than one that stays. Were the times those
        of a camera's sightings, an offset of half an interval would make the residuals smaller, and be preferred for
        that: the clocks came out 23 us off with sightings every 2 ms. So the shares are evenly spread.
        """
        apart_us = min(2 * FARTHEST_US, self.interval_us)
        return t_us + ((GOLDEN * np.arange(len(t_us))) % 1.0 - 0.5) * apart_us


def body_tracks(
    tracks: Mapping[str, PointTrack], body_m: Array, sigmas: Mapping[str, Array] | None = None, *, clean: bool = True
) -> BodyTracks:
    """The tracks of all cameras by name; of dense ones, strays that the neighbours do not expect are left out.

    Args:
        tracks: pixels, times and markers of each camera, by its name.
        body_m: (M, 3) places of the markers on the body, m; one row is a ball.
        sigmas: (N,) standard deviation of each sighting of a camera, relative to the others; 1 without it.
        clean: whether strays are looked for.
    """
    kept, weights = [], []
    for name, track in tracks.items():
        sigma = sigmas[name] if sigmas is not None else np.ones(len(track.t_us))
        step = np.diff(track.t_us)[np.diff(track.marker) == 0]
        dense = clean and len(step) > 0 and float(np.median(step)) <= DENSE_US
        left = clean_track(track) if dense else track
        # One number for time and marker, by which a sighting's sigma is found again after the cleaning.
        stride = int(track.marker.max(initial=0)) + 1
        key = track.t_us * stride + track.marker
        order = np.argsort(key, kind="stable")
        kept.append(left)
        weights.append(sigma[order][np.searchsorted(key[order], left.t_us * stride + left.marker)])
    every = np.concatenate([track.t_us for track in kept]) if kept else np.zeros(0)
    middle_us = float(np.median(every)) if len(every) else 0.0
    places_m = np.asarray(body_m, np.float64).reshape(-1, 3)
    most = max((int(track.marker.max(initial=0)) for track in kept), default=0)
    markers = len(places_m) if len(places_m) > 1 else most + 1
    return BodyTracks(tuple(tracks), tuple(kept), tuple(weights), places_m, markers, middle_us)


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


def _motion(track: PointTrack) -> Array:
    """(N, 5) of the parabola through each sighting and its neighbours: speed (2) px/us, half the acceleration (2)
    px/us^2, and the time that the three span, us; all 0 without both neighbours.
    """
    motion = np.zeros((len(track.t_us), 5))
    if len(track.t_us) < 3:
        return motion
    step = np.diff(track.t_us).astype(np.float64)
    before, after = step[:-1], step[1:]
    good = (track.marker[2:] == track.marker[:-2]) & (before > 0) & (after > 0)
    good &= np.maximum(before, after) <= NEIGHBOUR_US
    slopes = np.diff(track.uvs_px, axis=0) / np.maximum(step, 1.0)[:, None]
    span = np.maximum(before + after, 1.0)[:, None]
    speed = (slopes[:-1] * after[:, None] + slopes[1:] * before[:, None]) / span
    growth = (slopes[1:] - slopes[:-1]) / span
    motion[1:-1][good] = np.column_stack([speed, growth, span])[good]
    return motion


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
        # By marker, and in time within each: the last key is the first that counts.
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
