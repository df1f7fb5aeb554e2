import numpy as np
import pytest

from core.trajectory.ball_kernel import LIFT, TOUCHES
from core.trajectory.filter import Foreseen, MixedPaths, Paths, mix
from core.trajectory.filter_kernel import ROWS

pytestmark = pytest.mark.numeric


def foreseen(weight: float, seed: int, *, lands: bool = True) -> Foreseen:
    """An estimate of a ball in the air with random neighbours."""
    rng = np.random.default_rng(seed)
    states = np.tile([1.0, 0.0, 0.5, -5.0, 0.0, 1.0, 0, 0, 0, 0.5, 0.9, 0.2, 0.0, 0.0], (ROWS, 1))
    states[0, :6] += rng.normal(0, 0.05, 6)
    moves = rng.normal(0, 0.01, (ROWS // 2, 6))
    states[1::2, :6], states[2::2, :6] = states[0, :6] + moves, states[0, :6] - moves
    states[1:, 6:] = states[0, 6:]
    found, root = rng.normal(0, 1, TOUCHES), rng.normal(0, 1, (TOUCHES, TOUCHES))
    found[4:8] = np.nan
    if not lands:
        found[8:12] = np.nan
    return Foreseen(weight, found, root @ root.T, Paths(1.0, states, 0.1 * LIFT))


def test_mean_and_covariance_are_those_of_the_mixture() -> None:
    parts = [foreseen(0.7, 1), foreseen(0.2, 2), foreseen(0.1, 3)]
    found, spread, paths = mix(parts)
    there = np.isfinite(parts[0].found)
    mean = sum(part.weight * part.found for part in parts)
    np.testing.assert_allclose(found[there], mean[there])
    assert np.isnan(found[~there]).all()
    second = sum(part.weight * (part.spread + np.outer(part.found, part.found)) for part in parts)
    expected = second - np.outer(mean, mean)
    np.testing.assert_allclose(spread[np.ix_(there, there)], expected[np.ix_(there, there)])
    assert isinstance(paths, MixedPaths)


def test_positions_vary_by_what_each_says_and_by_how_far_they_are_apart() -> None:
    parts = [foreseen(0.7, 1), foreseen(0.3, 2)]
    _, _, paths = mix(parts)
    t_s = np.array([1.05, 1.1])
    each = [part.paths.at(t_s) for part in parts]
    means = np.array([ps[0] for ps in each])
    variances = np.array([(((ps[1::2] - ps[2::2]) / 2) ** 2).sum(axis=0) for ps in each])
    mean = 0.7 * means[0] + 0.3 * means[1]
    expected = 0.7 * (variances[0] + (means[0] - mean) ** 2) + 0.3 * (variances[1] + (means[1] - mean) ** 2)
    ps = paths.at(t_s)
    np.testing.assert_allclose(ps[0], mean)
    np.testing.assert_allclose((((ps[1::2] - ps[2::2]) / 2) ** 2).sum(axis=0), expected)
    np.testing.assert_allclose(paths.nominal().at(t_s)[0], mean)


def test_one_alone_is_left_as_it_is_and_others_that_touch_something_else_are_left_out() -> None:
    one, other = foreseen(0.6, 1), foreseen(0.4, 2, lands=False)
    for parts in ([one], [one, other]):
        found, spread, paths = mix(parts)
        assert found is one.found and spread is one.spread and paths is one.paths
    with pytest.raises(IndexError):
        mix([])


def test_crossings_of_a_mixture_are_the_mean_of_those_of_its_parts_and_spread_by_their_distance() -> None:
    parts = [foreseen(0.7, 1), foreseen(0.3, 2)]
    _, _, paths = mix(parts)
    xs = np.array([0.5, 0.0])
    found, spread = paths.crossings(xs)
    each = [part.paths.crossings(xs) for part in parts]
    np.testing.assert_allclose(found, 0.7 * each[0][0] + 0.3 * each[1][0])
    apart = each[0][0][1] - each[1][0][1]
    expected = 0.7 * each[0][1][1] + 0.3 * each[1][1][1] + 0.21 * np.outer(apart, apart)
    np.testing.assert_allclose(spread[1], expected, atol=1e-15)
    np.testing.assert_allclose(found[:, 1], xs)
