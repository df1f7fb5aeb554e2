"""By how much labels are shifted against the events, in time and in pixels: from a detector's answers to the events.

The labels are a path in time; the detector's answers are points on the same path if both agree. The time is searched
where most answers lie on the path moved by one common vector, then time and vector are fitted together, robustly. Where
a ball flies evenly, a shift in time and one in pixels look the same: the fit's own uncertainty says so, and nothing is
found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FARTHEST_US: Final = 25_000
FARTHEST_PX: Final = 40.0
STEP_US: Final = 500
"""Step of the search; a ball at 3,000 px/s moves 1.5 px meanwhile."""
LONGEST_GAP_US: Final = 5_000
"""Between two labels that still belong to one path."""
NEAR_PX: Final = 3.0
"""An answer this near the moved path counts in the search."""
BIN_PX: Final = 2.0
MIN_ANSWERS: Final = 50
MIN_SHARE: Final = 0.4
"""Least share of the answers beside labels that have to lie on the moved path."""
MAX_RIVAL: Final = 0.85
"""Share of those that another time, more than `RIVAL_US` off, may reach."""
RIVAL_US: Final = 4_000
MAX_SIGMA_US: Final = 150.0
MAX_SIGMA_PX: Final = 0.15
CORRELATED: Final = 4.0
"""So many neighbouring answers err alike: the fit's variance is that much larger than of independent ones."""
MAX_CONDITION: Final = 1e6
"""Largest condition number of the fit's equations, each unknown in its own unit: beyond, an even flight leaves time and
pixels open."""
ROUNDS: Final = 20


@dataclass(frozen=True, slots=True)
class LabelShift:
    """What has to be added to the labels so that they fit the events, and how sure that is."""

    found: bool
    reason: str
    """Why nothing was found; empty if it was."""
    dt_us: float
    du_px: float
    dv_px: float
    sigma_us: float
    sigma_px: float
    confidence: float
    """0 to 1: the share of answers on the moved path, less that of the best other time."""
    answers: int
    """On the moved path."""

    @property
    def is_zero(self) -> bool:
        """Whether it was found and is none: within three standard deviations, or what nobody would notice."""
        near_us, near_px = max(300.0, 3 * self.sigma_us), max(0.3, 3 * self.sigma_px)
        return self.found and abs(self.dt_us) <= near_us and max(abs(self.du_px), abs(self.dv_px)) <= near_px


def find_label_shift(
    label_t_us: NDArray[np.int64],
    label_uvs_px: NDArray[np.float64],
    answer_t_us: NDArray[np.int64],
    answer_uvs_px: NDArray[np.float64],
) -> LabelShift:
    """The shift of labels (N,), (N, 2), times ascending, against a detector's answers (M,), (M, 2).

    Args:
        label_t_us: (N,) times of the labels, ascending.
        label_uvs_px: (N, 2) their centres.
        answer_t_us: (M,) times of the answers.
        answer_uvs_px: (M, 2) their centres; nan: no answer.
    """
    path = _Path(label_t_us, label_uvs_px)
    known = np.isfinite(answer_uvs_px).all(axis=1)
    times, uvs = answer_t_us[known].astype(np.float64), answer_uvs_px[known]
    steps = np.arange(-FARTHEST_US, FARTHEST_US + 1, STEP_US, dtype=np.float64)
    looks = [_look(path, times, uvs, dt_us) for dt_us in steps]
    counts = np.array([count for count, _, _ in looks])
    if not len(times) or counts.max(initial=0) < MIN_ANSWERS:
        return _nothing(f"fewer than {MIN_ANSWERS} answers of the detector lie on the labels' path")
    best = int(np.argmax(counts))
    fit = _fit(path, times, uvs, steps[best], looks[best][1])
    if fit is None:
        return _nothing("the labels' path and the answers do not fit each other")
    beside = looks[best][2]
    # A path that repeats itself, or a straight even one, fits at several shifts.
    rival = counts[np.abs(steps - fit.dt_us) > RIVAL_US].max(initial=0)
    share, other = fit.answers / max(1, beside), rival / max(1, beside)
    reason = ""
    if not np.isfinite(fit.sigma_us):
        reason = "time and pixels cannot be told apart: the ball flies too evenly"
    elif share < MIN_SHARE:
        reason = f"only {share:.0%} of the detector's answers lie on the labels' path"
    elif rival > MAX_RIVAL * counts[best]:
        reason = "another shift fits as well: the ball flies too evenly"
    elif fit.sigma_us > MAX_SIGMA_US or fit.sigma_px > MAX_SIGMA_PX:
        reason = f"time and pixels cannot be told apart (+-{fit.sigma_us:.0f} us, +-{fit.sigma_px:.2f} px)"
    elif abs(fit.dt_us) > FARTHEST_US - STEP_US or max(abs(fit.du_px), abs(fit.dv_px)) > FARTHEST_PX:
        reason = "the shift is larger than what is searched"
    confidence = float(np.clip(share - other, 0, 1)) if not reason else 0.0
    return LabelShift(
        not reason, reason, fit.dt_us, fit.du_px, fit.dv_px, fit.sigma_us, fit.sigma_px, confidence, fit.answers
    )


def _nothing(reason: str) -> LabelShift:
    return LabelShift(False, reason, 0.0, 0.0, 0.0, float("inf"), float("inf"), 0.0, 0)


class _Path:
    """Labels as a path that can be asked at any time: pieces without a gap, between labels linear."""

    def __init__(self, t_us: NDArray[np.int64], uvs_px: NDArray[np.float64]) -> None:
        known = np.isfinite(uvs_px).all(axis=1)
        self._t, self._uvs = t_us[known].astype(np.float64), uvs_px[known]
        steps = np.diff(self._t)
        whole = np.maximum(steps, 1.0)[:, None]
        self._slopes = np.where((steps <= LONGEST_GAP_US)[:, None], np.diff(self._uvs, axis=0) / whole, np.nan)

    def at(self, t_us: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Places (M, 2), px, and velocities, px/us; nan where there is no label on both sides."""
        if len(self._t) < 2:
            return np.full((len(t_us), 2), np.nan), np.full((len(t_us), 2), np.nan)
        row = np.clip(np.searchsorted(self._t, t_us, side="right") - 1, 0, len(self._t) - 2)
        inside = (t_us >= self._t[0]) & (t_us <= self._t[-1])
        slopes = np.where(inside[:, None], self._slopes[row], np.nan)
        return self._uvs[row] + slopes * (t_us - self._t[row])[:, None], slopes


def _look(
    path: _Path, times: NDArray[np.float64], uvs: NDArray[np.float64], dt_us: float
) -> tuple[int, NDArray[np.float64], int]:
    """Answers near the path moved by the vector that most of them share, that vector, and the answers beside labels."""
    places, _ = path.at(times - dt_us)
    off = (uvs - places)[np.isfinite(places).all(axis=1)]
    beside = len(off)
    off = off[(np.abs(off) <= FARTHEST_PX).all(axis=1)]
    if not len(off):
        return 0, np.zeros(2), beside
    bins = int(2 * FARTHEST_PX / BIN_PX)
    edges = np.linspace(-FARTHEST_PX, FARTHEST_PX, bins + 1)
    heaps, _, _ = np.histogram2d(off[:, 0], off[:, 1], bins=(edges, edges))
    wide = sum(np.roll(heaps, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1))
    peak = np.unravel_index(int(np.argmax(wide)), heaps.shape)
    centre = np.array([edges[peak[0]] + BIN_PX / 2, edges[peak[1]] + BIN_PX / 2])
    near = off[(np.abs(off - centre) <= NEAR_PX).all(axis=1)]
    vector = np.median(near, axis=0) if len(near) else centre
    return int(np.count_nonzero(np.hypot(*(off - vector).T) <= NEAR_PX)), vector, beside


@dataclass(frozen=True, slots=True)
class _Fit:
    dt_us: float
    du_px: float
    dv_px: float
    sigma_us: float
    sigma_px: float
    answers: int


def _fit(
    path: _Path, times: NDArray[np.float64], uvs: NDArray[np.float64], dt_us: float, vector: NDArray[np.float64]
) -> _Fit | None:
    """Time and vector together: least squares with weights that fall to nothing where an answer is far off."""
    state = np.array([dt_us, *vector])
    covariance, answers = np.full((3, 3), np.inf), 0
    for _ in range(ROUNDS):
        places, slopes = path.at(times - state[0])
        off = uvs - places - state[1:]
        usable = np.isfinite(off).all(axis=1) & (np.hypot(off[:, 0], off[:, 1]) < 3 * NEAR_PX)
        if np.count_nonzero(usable) < MIN_ANSWERS:
            return None
        off, slopes = off[usable], slopes[usable]
        distance = np.hypot(off[:, 0], off[:, 1])
        scale = max(0.1, 1.2 * float(np.median(distance)))
        weight = np.clip(1 - (distance / (4 * scale)) ** 2, 0, None) ** 2
        # off = uv - path(t - dt) - d: it grows by the velocity with dt, and falls with d
        J = np.zeros((len(off), 2, 3))
        J[:, :, 0], J[:, 0, 1], J[:, 1, 2] = -slopes, 1, 1
        normal = np.einsum("n,nki,nkj->ij", weight, J, J)
        right = np.einsum("n,nki,nk->i", weight, J, off)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / np.outer(size, size)
        if np.linalg.cond(scaled) > MAX_CONDITION:
            return _Fit(float(state[0]), float(state[1]), float(state[2]), np.inf, np.inf, answers)
        step = np.linalg.solve(scaled, right / size) / size
        state = state + step
        answers = int(np.count_nonzero(distance <= max(NEAR_PX, 3 * scale)))
        variance = float((weight * distance**2).sum() / max(1.0, 2 * weight.sum() - 3))
        covariance = CORRELATED * variance * np.linalg.inv(scaled) / np.outer(size, size)
        if abs(step[0]) < 0.1 and np.abs(step[1:]).max() < 1e-4:
            break
    sigma = np.sqrt(np.diag(covariance))
    dt, du, dv = (float(value) for value in state)
    return _Fit(dt, du, dv, float(sigma[0]), float(sigma[1:].max()), answers)
