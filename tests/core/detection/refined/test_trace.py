"""The trace of the refined detector: the answers of the fast path, and what its stages show."""

import math

import numpy as np
import pytest

from core.config import replace_setting
from core.detection import Detection, RefinedDetection, RefinedDetector, make_detector, refined_config
from core.detection.method_trace import setting_group
from core.detection.refined.ball_fit import Quality
from core.detection.refined.patch import MovingCircle
from core.detection.refined.track import BallTrack
from core.detection.refined.view import view_of
from core.detection.refined_config import RefinedConfig
from core.events import SensorSize

SENSOR = SensorSize(320, 240)


@pytest.fixture(scope="module")
def windows(make_scene, make_flight):
    flights = make_flight(), make_flight(u_px=260.0, v_px=60.0, du_px_per_ms=-0.6, r_px=25.0)
    return make_scene(*flights, noise_hz=5, duration_us=60_000).windows(1000)


@pytest.fixture(scope="module")
def traces(windows):
    detector = RefinedDetector(RefinedConfig(), SENSOR)
    return [detector.trace(window) for window in windows]


def bits(found: Detection | None) -> object:
    """Every number of an answer, to the last bit."""
    if not isinstance(found, RefinedDetection):
        return found
    numbers = (found.u_px, found.v_px, found.r_px, *found.velocity_px_per_ms, found.stretch_ms, *found.fit)
    return found.t_us, np.array(numbers).tobytes(), found.covariance.tobytes()


def test_the_answers_are_those_of_the_fast_path_to_the_last_bit(windows, traces) -> None:
    plain = RefinedDetector(RefinedConfig(), SENSOR)
    expected = [bits(plain.step(window)) for window in windows]
    assert [bits(trace.detection) for trace in traces] == expected
    assert sum(one is not None for one in expected) > 30


def test_every_window_may_be_traced_or_not(windows) -> None:
    mixed, plain = (RefinedDetector(RefinedConfig(), SENSOR) for _ in range(2))
    for number, window in enumerate(windows):
        found = mixed.trace(window).detection if number % 3 == 0 else mixed.step(window)
        assert bits(found) == bits(plain.step(window))


def test_the_edge_points_lie_on_the_circle_that_moves_with_them(traces) -> None:
    trace = traces[-1]
    (fit,) = (one for one in trace.fits if not one.reasons)
    edges, ball, quality = fit.edges, fit.ball, fit.quality
    good = ~edges.outlier
    assert good.sum() == quality.points and edges.outlier.mean() == pytest.approx(quality.stray)
    off_px = np.hypot(*(edges.moved_px - (ball.u, ball.v)).T) - ball.r
    assert off_px == pytest.approx(edges.residual_px)
    assert np.abs(edges.residual_px[good]).max() < 1.5
    ahead = np.abs(edges.angle_rad) < math.pi / 2
    assert (ahead == edges.leading)[good].mean() > 0.95, "the leading edge is in front"
    assert (edges.ms <= 0).all() and edges.ms.min() >= -fit.history_ms


def test_while_a_ball_is_tracked_nothing_is_searched(traces) -> None:
    assert traces[2].searched and traces[2].history_events > 0
    assert not traces[-1].searched and traces[-1].blobs == () == traces[-1].spans
    (track,) = traces[-1].tracks
    assert track.confirmed and track.missing == () and track.fit is not None and track.age_us > 30_000
    assert traces[-1].detection.t_us == traces[-1].end_us - traces[-1].delay_us


def test_a_stage_that_was_left_out_says_so_instead_of_counting_nothing(windows, traces) -> None:
    searched, tracked = (view_of(traces[at], windows[at], (), 1.0).counts for at in (2, -1))
    left_out = [name for name, count in tracked.items() if count.not_run]
    assert left_out == [setting_group("refined", stage) for stage in ("search", "candidates")]
    assert not any(count.not_run for count in searched.values())


def test_a_search_shows_its_pixels_its_blobs_and_whose_turn_it_was(traces) -> None:
    trace = next(one for one in traces if one.blobs)
    assert [one.span_us for one in trace.spans] == [1500, 5000, 16_000]
    u, v, width, height = trace.blobs[0].box_px
    span = next(one for one in trace.spans if one.span_us == trace.blobs[0].span_us)
    assert span.evaluated
    assert ((np.abs(span.x_px - u) <= width / 2 + 1) & (np.abs(span.y_px - v) <= height / 2 + 1)).sum() >= 4
    examined = [number for number, blob in enumerate(trace.blobs) if blob.status == "examined"]
    assert {fit.blob for fit in trace.fits if fit.origin == "blob"} == set(examined)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("radius_max_px", 5.0),
        ("confirm_fits", 20),
        ("fill_min", 1.0),
        ("points_min", 200),
        ("fresh_min", 0.9),
    ],
)
def test_a_limit_that_shuts_the_ball_out_is_named_with_its_numbers(make_scene, make_flight, setting, value) -> None:
    config = replace_setting(refined_config(), ("refined", setting), value)
    detector = make_detector("refined", SENSOR, config)
    named = []
    for window in make_scene(make_flight(), noise_hz=1, duration_us=30_000).windows(1000):
        if detector.step(window) is None:
            named += [one for one in detector.why_not() if one.setting == f"refined.{setting}"]  # type: ignore[attr-defined]
    assert len(named) >= 10
    measured, limit = float(np.median([one.value for one in named])), float(np.median([one.limit for one in named]))
    assert (measured > limit) == setting.endswith("max_px")


def test_a_track_that_is_no_ball_yet_says_what_it_lacks() -> None:
    quality = Quality(0.2, 120.0, 1.0, 1.0, 0.02, 0.1, 0.9, 5.0, 1.0, 0.33)
    track = BallTrack(0, MovingCircle(100.0, 50.0, 2.0, 0.0, 10.0), np.eye(6), quality)
    missing = {one.setting: (one.value, one.limit) for one in track.missing(RefinedConfig(), 0.0)}
    assert missing["refined.confirm_fits"] == (1, 4)
    assert missing["refined.evidence_min"][0] == 0.0
    assert "refined.both_edges_min" not in missing


def test_one_fit_may_be_enough_for_a_ball_if_the_settings_say_so(make_scene, make_flight) -> None:
    """Its radii, which must be steady, are none yet."""
    open_limits = {"confirm_fits": 1, "evidence_min": 0.0, "confirm_motion_px": 0.0, "pace_min_per_ms": 0.0}
    detectors = [RefinedDetector(RefinedConfig(**limits), SENSOR) for limits in (open_limits, {})]  # type: ignore[arg-type]
    windows = make_scene(make_flight(), noise_hz=1, duration_us=30_000).windows(1000)
    first = [next(n for n, window in enumerate(windows) if one.step(window) is not None) for one in detectors]
    assert first[0] < first[1]


def test_the_largest_blob_beyond_a_limit_says_why_there_is_none(make_scene, make_flight) -> None:
    flight = make_flight(u_px=150.0, v_px=120.0, r_px=60.0, du_px_per_ms=1.0)
    detector = RefinedDetector(RefinedConfig(radius_max_px=10.0), SENSOR)
    traces, reasons = [], []
    for window in make_scene(flight, duration_us=20_000).windows(1000):
        traces.append(detector.trace(window))
        reasons += detector.why_not()
    (side, *_) = (one for one in reasons if one.reason == "side of the blob")
    assert side.setting == "refined.radius_max_px" and side.value > side.limit == 40.0
    rejected = [blob for trace in traces for blob in trace.blobs if blob.status == "rejected"]
    assert rejected and all(blob.reasons for blob in rejected)
    assert side.value in [max(blob.box_px[2:]) for blob in rejected]


def test_noise_that_has_no_blobs_names_the_setting_of_the_search(make_scene) -> None:
    detector = RefinedDetector(RefinedConfig(), SENSOR)
    for window in make_scene(noise_hz=5, duration_us=5000).windows(1000):
        assert detector.step(window) is None
        (reason,) = detector.why_not()
        assert (reason.setting, reason.value) == ("refined.neighbours_min", 0)


def test_between_two_searches_the_reasons_are_those_of_the_last_candidates(make_scene, make_flight) -> None:
    """A slow disc is only in the time spans that are searched in every second or fourth window."""
    flight = make_flight(u_px=150.0, v_px=120.0, r_px=14.0, du_px_per_ms=0.3)
    detector = RefinedDetector(RefinedConfig(points_min=200), SENSOR)
    reasons = []
    for window in make_scene(flight, duration_us=60_000).windows(1000):
        assert detector.step(window) is None
        reasons.append({one.setting for one in detector.why_not()})
    late = reasons[-20:]
    assert all("refined.neighbours_min" not in settings for settings in late)
    assert sum("refined.points_min" in settings for settings in late) > 10


def test_a_candidate_that_is_given_up_says_by_how_much(windows) -> None:
    detector = RefinedDetector(RefinedConfig(), SENSOR)
    trace = next(one for one in map(detector.trace, windows) if one.tracks)
    number = len(windows[: windows.index(next(one for one in windows if one.end_us == trace.end_us))])
    for track in detector.tracks:
        track.evidence = -9.0
    trace = detector.trace(windows[number + 1])
    given_up = [track for track in trace.tracks if track.given_up]
    assert given_up and all(track.fit is not None for track in given_up)
    (reason,) = given_up[0].given_up
    assert reason.setting == "refined.given_up" and reason.value is not None and reason.value < -3.0 == reason.limit
    assert trace.detection is None and reason in detector.why_not()


def test_limits_that_were_constants_are_settings() -> None:
    track = BallTrack(0, MovingCircle(100.0, 50.0, 2.0, 0.0, 10.0), np.eye(6), Quality(*[1.0] * 10))
    track.evidence = -4.0
    assert track.is_terminated
    track.config = RefinedConfig(given_up=-6.0)
    assert not track.is_terminated
