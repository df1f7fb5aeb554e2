"""Prediction from a mixture of estimates of a flight: mean and covariance.

The first two moments of a mixture of normal distributions are exact here, of what is touched and of every position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.trajectory.ball_kernel import places

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """The estimate and its sigma points (one sigma along each independent direction), with what they touch."""

    t_s: float
    states: Array
    """(27, 14)."""
    lift: float

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        ps = np.empty((len(self.states), len(t_s), 3))
        places(self.states, self.t_s, np.ascontiguousarray(t_s), self.lift, ps)
        return ps

    def nominal(self) -> Paths:
        """The estimate alone, without its neighbours."""
        return Paths(self.t_s, self.states[:1], self.lift)


@dataclass(frozen=True, slots=True, eq=False)
class Foreseen:
    """Next contacts of one estimate."""

    weight: float
    """Its probability in the mixture."""
    found: Array
    """(22,), see `ball_kernel.touches`."""
    spread: Array
    """(22, 22) covariance of `found`."""
    paths: Paths


@dataclass(frozen=True, slots=True, eq=False)
class MixedPaths:
    """Several estimates and their neighbours as one.

    Row 0 is the mean; pairs of rows are what each of them, and their distances from the mean, add to the variance.
    """

    weights: Array
    """(M,) sum 1."""
    parts: tuple[Paths, ...]

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        each = [part.at(t_s) for part in self.parts]
        mean = np.einsum("m,mkj->kj", self.weights, np.array([ps[0] for ps in each]))
        rows = [mean[None]]
        for weight, ps in zip(self.weights, each, strict=True):
            moves = np.sqrt(weight) * np.concatenate([ps[:1] - mean, (ps[1::2] - ps[2::2]) / 2])
            rows.append(np.stack([mean + moves, mean - moves], axis=1).reshape(2 * len(moves), *mean.shape))
        return np.concatenate(rows)

    def nominal(self) -> MixedPaths:
        """The mean, and what the distances from it say: without the neighbours of each."""
        return MixedPaths(self.weights, tuple(part.nominal() for part in self.parts))


def mix(parts: Sequence[Foreseen]) -> tuple[Array, Array, Paths | MixedPaths]:
    """What all together touch (22,), its covariance (22, 22), and their paths.

    The first one says what is touched: others that touch something else are left out.
    """
    there = np.isfinite(parts[0].found)
    alike = [part for part in parts if (np.isfinite(part.found) == there).all()]
    if len(alike) == 1:
        return alike[0].found, alike[0].spread, alike[0].paths
    weights = np.array([part.weight for part in alike])
    weights /= weights.sum()
    all_found = np.array([part.found for part in alike])
    found = weights @ all_found
    apart = np.where(there, all_found - found, 0.0)
    spread = np.einsum("m,mij->ij", weights, np.array([part.spread for part in alike]))
    spread += (apart * weights[:, None]).T @ apart
    return found, spread, MixedPaths(weights, tuple(part.paths for part in alike))
