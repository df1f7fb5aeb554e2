"""Whole flights out of proposals of two cameras: what one ball explains, and what it does not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.labels.assistance import FRAME_US, TrialServes, make_serves
from core.recordings import PixelTruth, open_recording
from labels.assist import Proposals, propose, whole_flight
from tests.labels.assist.whole_flight_trial import try_whole_flights

pytestmark = pytest.mark.numeric
SIGMA_PX = 0.3


@pytest.fixture(scope="module")
def serve() -> TrialServes:
    return make_serves(1, np.random.default_rng(3))


def proposals_of(truth: PixelTruth, seed: int) -> Proposals:
    rng, rows = np.random.default_rng(seed), truth.visible
    x, y = (values[rows] + rng.normal(0, SIGMA_PX, rows.sum()) for values in (truth.u_px, truth.v_px))
    return Proposals(truth.t_us[rows], x, y, truth.r_px[rows], np.zeros((len(x), 3)), FRAME_US, "made up")


def moved(proposals: Proposals, rows: np.ndarray, by_px: tuple[float, float]) -> Proposals:
    x, y = proposals.x_px.copy(), proposals.y_px.copy()
    x[rows], y[rows] = x[rows] + by_px[0], y[rows] + by_px[1]
    return Proposals(proposals.t_us, x, y, proposals.r_px, proposals.covariance_px2, FRAME_US, "made up")


def test_a_flight_reaches_from_bounce_to_bounce_and_doubts_nothing_without_reason(serve) -> None:
    cameras = tuple(serve.cameras.values())
    pair = tuple(proposals_of(truth, seed) for seed, truth in enumerate(serve.truth.values()))
    first, second = serve.bounces_us[:2]
    found = whole_flight(cameras, pair, (first + second) // 2)
    assert found is not None
    seen_us = min(int(part.t_us[part.t_us > first][0]) for part in pair)
    assert found.start_us == pytest.approx(max(first, seen_us), abs=2.5 * FRAME_US)
    assert found.end_us == pytest.approx(second, abs=2.5 * FRAME_US)
    for part, agreed, doubted in zip(pair, found.agreed, found.doubted, strict=True):
        within = part.between(found.start_us, found.end_us + 1)
        assert len(agreed) + len(doubted) == len(within)
        assert len(doubted) <= 0.02 * len(within)


@pytest.mark.parametrize("by_px", [(4.0, 0.0), (0.0, -4.0), (20.0, 15.0)])
def test_what_is_off_the_flight_is_doubted_and_said_by_how_much(serve, by_px) -> None:
    cameras = tuple(serve.cameras.values())
    here, there = (proposals_of(truth, seed) for seed, truth in enumerate(serve.truth.values()))
    first, second = serve.bounces_us[:2]
    inside = np.flatnonzero((here.t_us > first + 20_000) & (here.t_us < second - 20_000))
    wrong = inside[[3, 17, 18, 19, 40]]
    found = whole_flight(cameras, (moved(here, wrong, by_px), there), int(here.t_us[inside[18]]))
    assert found is not None
    said = {doubt.t_us: doubt.off_px for doubt in found.doubted[0]}
    assert set(here.t_us[wrong].tolist()) <= set(said) and len(said) <= len(wrong) + 2
    assert not set(here.t_us[wrong].tolist()) & set(found.agreed[0].t_us.tolist())
    for t_us in here.t_us[wrong].tolist():
        assert said[t_us] == pytest.approx(np.hypot(*by_px), abs=4 * SIGMA_PX)


def test_what_no_ball_explains_is_no_flight(serve) -> None:
    cameras = tuple(serve.cameras.values())
    here, there = (proposals_of(truth, seed) for seed, truth in enumerate(serve.truth.values()))
    t_us = (serve.bounces_us[0] + serve.bounces_us[1]) // 2
    still = Proposals(
        here.t_us, np.full(len(here), 640.0), np.full(len(here), 360.0), here.r_px, here.covariance_px2, FRAME_US, ""
    )
    assert whole_flight(cameras, (still, there), t_us) is None
    nothing = here.between(0, 0)
    assert whole_flight(cameras, (nothing, there), t_us) is None
    assert whole_flight(cameras, (here, nothing), t_us) is None


def test_a_flight_goes_on_behind_what_hides_the_ball_for_a_moment(serve) -> None:
    cameras = tuple(serve.cameras.values())
    pair = [proposals_of(truth, seed) for seed, truth in enumerate(serve.truth.values())]
    first, second = serve.bounces_us[:2]
    middle = (first + second) // 2
    hidden = [part.rows(np.abs(part.t_us - middle) > 30_000) for part in pair]
    found = whole_flight(cameras, (hidden[0], hidden[1]), middle - 40_000)
    assert found is not None and found.start_us < middle - 60_000 and found.end_us > middle + 60_000


def test_a_person_with_whole_flights_labels_a_rally_in_seconds_and_takes_no_planted_error() -> None:
    trial = try_whole_flights(6, np.random.default_rng(11))
    assert trial.planted > 80 and trial.doubted > 60
    assert trial.centres >= 1000 and trial.seconds < 300
    assert trial.wrong <= 0.005
    assert np.percentile(trial.errors_px, 95) <= 1.0


@pytest.mark.gate
def test_the_detectors_own_proposals_of_a_recording_are_taken_as_a_flight(serve_recording) -> None:
    with open_recording(serve_recording) as recording:
        streams = list(recording.cameras.values())
        pair = tuple(propose(stream, 0, recording.duration_us) for stream in streams)
        cameras = tuple(stream.calibration for stream in streams)
        found = whole_flight(cameras, pair, int(pair[0].t_us[len(pair[0]) // 2]))
        assert found is not None
        for stream, agreed in zip(streams, found.agreed, strict=True):
            truth = stream.truth.at(agreed.t_us)
            errors = np.hypot(agreed.x_px - truth.u_px, agreed.y_px - truth.v_px)
            assert len(agreed) > 40 and np.nanpercentile(errors, 95) < 1.0
