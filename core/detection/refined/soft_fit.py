"""Fit of a ball without a sharp rim: a glow, or a disc out of focus, whose light falls off over many pixels.

Such a ball has no edge points: while it moves, pixels all over its leading half brighten and all over its trailing half
darken, and many of them several times. So every event counts, by its place and its polarity. For a round ball the two
polarities lie symmetrically about the centre, each of them by the same vector `m` along the motion:

    x = c + v t + s m        (s = 1 for ON, -1 for OFF; t = 0 at the end of the window)

which is linear in centre, velocity and `m`. Unequal thresholds change how many events a polarity has, not the centre.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from core.detection.refined.ball_fit import SECTORS, Reach, Work, span_for
from core.detection.refined.circle_fit import factorise, solve
from core.detection.refined.history import Recent
from core.detection.refined.patch import HALF, MAX_POINTS, SIDE
from core.jit import njit

APERTURE: Final = 1.25
"""Events within this many radii of the centre belong to the ball. Above 1, so that a first radius that is too small
grows from one iteration to the next; with a wide margin the surroundings would."""
RING: Final = 1.75
"""Outer end, in radii, of the ring around the ball in which there should be few events."""
ITERATIONS: Final = 4
"""Iterations per round: a track's prediction is near, a blob has three rounds."""
SPREAD: Final = 0.5
"""Standard deviation of an event's place about the centre of its polarity, in radii: a half disc has 0.26 along the
motion and 0.5 across it."""
RADIUS_SPREAD: Final = 0.29
"""Standard deviation of the radius from one event, in radii: that of r^2 over a disc, R^2 / sqrt(12), halved twice."""
COVERED: Final = 0.15
"""A sector is covered with this share of the mean sector's events; beside the motion there are few."""
FEWEST_EVENTS: Final = 30
"""Fewest events of a fit: five of each unknown."""


@njit
def fit_soft(recent: Recent, work: Work, end_us: int, reach: Reach, rounds: int) -> bool:
    """Fit from `work.fit.estimate` with its prior; estimate, quality and covariance are then in `work`."""
    estimate = work.fit.estimate
    history_ms = span_for(end_us, math.hypot(estimate[2], estimate[3]), reach).history_ms
    begin = np.searchsorted(recent.t_us, end_us - int(1000.0 * history_ms))
    lobe = np.zeros(2)
    fine = True
    work.counts[:] = 0
    for _ in range(rounds * ITERATIONS):
        fine = _iterate(recent, begin, end_us, work, lobe)
        if not fine:
            break
    if fine:
        _judge_soft(recent, begin, end_us, work, lobe, history_ms)
    return fine


@njit
def _iterate(recent, begin, end_us, work, lobe):
    """One round of weighted least squares with the events in the aperture; false where they determine nothing."""
    fit, estimate = work.fit, work.fit.estimate
    u, v, vu, vv, r = estimate[0], estimate[1], estimate[2], estimate[3], estimate[4]
    most2 = (APERTURE * r) ** 2
    count, squares = 0, 0.0
    matrix, right = np.zeros((3, 3)), np.zeros((2, 3))
    row = np.ones(3)
    for k in range(begin, len(recent.t_us)):
        ms = 0.001 * (recent.t_us[k] - end_us)
        bent = 0.5 * ms * ms
        x, y = recent.x_px[k] - fit.bend[0] * bent, recent.y_px[k] - fit.bend[1] * bent
        du, dv = x - u - vu * ms, y - v - vv * ms
        distance2 = du * du + dv * dv
        if distance2 > most2:
            continue
        count += 1
        squares += distance2
        row[1], row[2] = ms, 1.0 if recent.on[k] else -1.0
        for i in range(3):
            right[0, i] += row[i] * x
            right[1, i] += row[i] * y
            for j in range(3):
                matrix[i, j] += row[i] * row[j]
    work.counts[0] = min(count, MAX_POINTS)
    if count < FEWEST_EVENTS:
        return False
    per_event = 1.0 / (SPREAD * r) ** 2
    unit, factor, normal = np.zeros(3), np.empty((3, 3)), np.empty((3, 3))
    answer = np.empty(3)
    work.covariance[:] = 0.0
    for axis in range(2):
        normal[:] = per_event * matrix
        right[axis] *= per_event
        for i in range(2):
            place = axis + 2 * i
            normal[i, i] += fit.information[place]
            right[axis, i] += fit.information[place] * fit.prior[place]
        normal[2, 2] += per_event  # keeps it regular where all events have one polarity
        if not factorise(normal, factor):
            return False
        solve(factor, right[axis], answer)
        estimate[axis], estimate[axis + 2], lobe[axis] = answer[0], answer[1], answer[2]
        for i in range(2):
            unit[:] = 0.0
            unit[i] = 1.0
            solve(factor, unit, answer)
            work.covariance[axis + 2 * i, axis], work.covariance[axis + 2 * i, axis + 2] = answer[0], answer[1]
    seen = count / (RADIUS_SPREAD * r) ** 2
    total = seen + fit.information[4]
    estimate[4] = (seen * math.sqrt(2.0 * squares / count) + fit.information[4] * fit.prior[4]) / total
    work.covariance[4, 4], work.covariance[5, 5] = 1.0 / total, 1.0
    estimate[5] = 0.0  # there are no edges, and so no latency between them
    return 1.0 < estimate[4] < HALF


@njit
def _judge_soft(recent, begin, end_us, work, lobe, history_ms):
    """Write the quality of the fit, and its events as the points of a trace.

    The fields of `Quality` are those of a ball with a rim where that makes sense. Else: `residual_px` is how much the
    mean distance of the events varies from sector to sector, `points` are events, `inside` those of the wrong polarity
    for their half per right one, `stray` the density of events around the disc over that in it, `fill` events per pixel
    of the disc, `brighter` the surplus of right ones, less where the direction of motion is uncertain.
    """
    estimate, points, quality, patch, bend = work.fit.estimate, work.points, work.quality, work.patch, work.fit.bend
    r = estimate[4]
    x0, y0 = round(estimate[0]) - HALF - 1, round(estimate[1]) - HALF - 1
    sectors, sums, squares = np.zeros(SECTORS), np.zeros(SECTORS), 0.0
    count, right, fresh, ring, touched, stored = 0, 0, 0, 0, 0, 0
    heading = math.atan2(estimate[3], estimate[2])
    for k in range(begin, len(recent.t_us)):
        ms = 0.001 * (recent.t_us[k] - end_us)
        du = recent.x_px[k] - estimate[0] - (estimate[2] + 0.5 * bend[0] * ms) * ms
        dv = recent.y_px[k] - estimate[1] - (estimate[3] + 0.5 * bend[1] * ms) * ms
        distance = math.hypot(du, dv)
        if distance > APERTURE * r:
            ring += distance < RING * r
            continue
        count += 1
        squares += distance * distance
        fits = (du * lobe[0] + dv * lobe[1] >= 0.0) == recent.on[k]
        right += fits
        fresh += ms > -history_ms / 3.0
        turn = (math.atan2(dv, du) - heading + 0.5 * math.pi) / (2.0 * math.pi)
        sector = math.floor((turn - math.floor(turn)) * SECTORS) % SECTORS
        sectors[sector] += 1.0
        sums[sector] += distance
        row, column = recent.y_px[k] - y0, recent.x_px[k] - x0
        if 0 <= row < SIDE + 2 and 0 <= column < SIDE + 2 and patch.first[row, column] == 0:
            patch.first[row, column] = 1
            patch.touched[touched] = row * (SIDE + 2) + column
            touched += 1
        if stored < MAX_POINTS:
            points.u[stored], points.v[stored], points.ms[stored] = recent.x_px[k], recent.y_px[k], ms
            points.events[stored], points.weight[stored] = 1.0, 1.0 if fits else 0.0
            points.lead[stored] = (1.0 if recent.on[k] else -1.0) if sector < SECTORS // 2 else 0.0
            stored += 1
    for k in range(touched):
        row, column = divmod(patch.touched[k], SIDE + 2)
        patch.first[row, column] = 0
    half = SECTORS // 2
    mean = sums.sum() / count
    spread2, uneven, lead, trail = squares / count - mean * mean, 0.0, 0, 0
    for k in range(SECTORS):
        if sectors[k] > 0.0:  # the sampling error of each sector's mean is taken out
            uneven += sectors[k] * (sums[k] / sectors[k] - mean) ** 2 - spread2
        covered = sectors[k] >= max(1.0, COVERED * count / SECTORS)
        lead += covered and k < half
        trail += covered and k >= half
    # Which polarity leads is known as well as the direction of motion is: a ball that turns back has none for a while.
    towards = (estimate[2] * lobe[0] + estimate[3] * lobe[1]) / max(math.hypot(lobe[0], lobe[1]), 1e-6)
    certain = min(max(towards / (2.0 * math.sqrt(work.covariance[2, 2])), -1.0), 1.0)
    quality[0] = math.sqrt((max(uneven, 0.0) + max(spread2, 1e-6)) / count)  # what is left is that of the whole mean
    quality[1] = count
    quality[2], quality[3] = lead / half, trail / half
    quality[4] = (count - right) / max(1, right)
    quality[5] = min(1.0, ring / count * APERTURE**2 / (RING**2 - APERTURE**2))
    quality[6] = min(1.0, count / (math.pi * r * r))
    quality[7] = count / max(1, touched)
    quality[8] = (2.0 * right / count - 1.0) * certain
    quality[9] = fresh / count
    work.counts[0] = stored
