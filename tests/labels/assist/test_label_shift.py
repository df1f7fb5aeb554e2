"""Shifts between labels and what a detector finds in the events are found where there are any, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from labels.assist.label_shift import find_label_shift

pytestmark = pytest.mark.numeric


def rally(rng, flights=6):
    """The ball's true path in a picture, each ms: arcs of some 400 ms that turn round at the rackets."""
    times, uvs = [], []
    start, direction = np.array([rng.uniform(200, 500), rng.uniform(200, 500)]), 1.0
    for flight in range(flights):
        t = np.arange(0, 400.0)
        speed = rng.uniform(0.8, 2.0) * direction
        u = start[0] + speed * t
        v = start[1] + rng.uniform(-0.8, -0.2) * t + 0.5 * rng.uniform(0.002, 0.004) * t**2
        times.append(1000 * (t + 420 * flight) + 500)
        uvs.append(np.stack([u, v], axis=1))
        start, direction = uvs[-1][-1], -direction
    return np.concatenate(times).astype(np.int64), np.concatenate(uvs)


def answers_of(rng, t_us, uvs, *, noise_px=0.4, missed=0.3, wrong=0.08):
    """What a detector says: near the path, some missed, some of something else."""
    at = np.sort(rng.integers(t_us[0], t_us[-1], len(t_us)))
    row = np.searchsorted(t_us, at) - 1
    whole = np.diff(t_us)[row] <= 1000
    at = at[whole & (rng.random(len(at)) > missed)]
    found = np.stack([np.interp(at, t_us, uvs[:, axis]) for axis in (0, 1)], axis=1)
    found += rng.normal(0, noise_px, found.shape)
    odd = rng.random(len(at)) < wrong
    found[odd] = rng.uniform(0, 720, (np.count_nonzero(odd), 2))
    return at, found


def test_shifts_of_20_ms_and_30_px_are_found_in_99_of_100_rallies():
    rng = np.random.default_rng(4)
    good = 0
    for _ in range(100):
        t_us, uvs = rally(rng)
        at, found = answers_of(rng, t_us, uvs)
        dt_us, angle, size = rng.uniform(-20_000, 20_000), rng.uniform(0, 2 * np.pi), rng.uniform(0, 30)
        vector = size * np.array([np.cos(angle), np.sin(angle)])
        shift = find_label_shift(t_us - round(dt_us), uvs - vector, at, found)
        near = abs(shift.dt_us - round(dt_us)) < 300 and np.abs([shift.du_px, shift.dv_px] - vector).max() < 0.3
        good += shift.found and near
    assert good >= 99


def test_no_shift_is_said_to_be_none():
    rng = np.random.default_rng(5)
    for _ in range(20):
        t_us, uvs = rally(rng)
        shift = find_label_shift(t_us, uvs, *answers_of(rng, t_us, uvs))
        assert shift.is_zero
        assert shift.confidence > 0.3


def test_nothing_is_found_where_the_answers_are_of_something_else():
    rng = np.random.default_rng(6)
    for _ in range(20):
        t_us, uvs = rally(rng)
        at, _ = answers_of(rng, t_us, uvs)
        other = rng.uniform(0, 720, (len(at), 2))
        assert not find_label_shift(t_us, uvs, at, other).found
        _, another = rally(np.random.default_rng(int(rng.integers(1 << 30))))
        assert not find_label_shift(t_us, uvs, *answers_of(rng, t_us, another)).found


def test_an_even_flight_cannot_tell_time_from_pixels():
    rng = np.random.default_rng(7)
    t_us = np.arange(500, 400_000, 1000)
    uvs = np.stack([100 + t_us / 800, 300 + t_us / 2000], axis=1)
    shift = find_label_shift(t_us - 5000, uvs, *answers_of(rng, t_us, uvs))
    assert not shift.found
    assert "too evenly" in shift.reason or "cannot be told apart" in shift.reason


@pytest.mark.parametrize("count", [0, 1, 30])
def test_few_labels_or_answers_find_nothing(count):
    rng = np.random.default_rng(8)
    t_us, uvs = rally(rng)
    at, found = answers_of(rng, t_us, uvs)
    assert not find_label_shift(t_us[:count], uvs[:count], at, found).found
    assert not find_label_shift(t_us, uvs, at[:count], found[:count]).found


def test_the_uncertainty_covers_the_error():
    rng = np.random.default_rng(9)
    pulls = []
    for _ in range(40):
        t_us, uvs = rally(rng)
        shift = find_label_shift(t_us - 7000, uvs + 4.0, *answers_of(rng, t_us, uvs))
        pulls.append(((shift.dt_us - 7000) / shift.sigma_us, (shift.du_px + 4) / shift.sigma_px))
    assert np.abs(pulls).max() < 3
