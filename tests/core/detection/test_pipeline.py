import itertools

import numpy as np
import pytest

from core.config import replace_setting
from core.detection import FastDetector, ReferenceDetector, TrackState, auto_config, paper_config, trace_window
from core.detection.fast.cluster import grid_labels
from core.events import Events, SensorSize, Window

STAGES = ["roi", "denoise", "cluster", "polarity", "geometry", "localise"]


def test_a_bright_ball_is_found_near_its_centre_in_nearly_every_window(make_scene, make_flight) -> None:
    flight = make_flight(du_px_per_ms=2.5)
    detector = ReferenceDetector(paper_config())
    found = [detector.step(window) for window in make_scene(flight, duration_us=80_000).windows()]
    errors = [np.hypot(d.u_px - flight.centre(d.t_us)[0], d.v_px - flight.centre(d.t_us)[1]) for d in found if d]
    assert len(errors) >= 38 and np.median(errors) < 2.5 and max(errors) < 4.0


def test_a_dark_ball_is_found_on_its_leading_edge_by_auto_and_lags_behind_for_the_paper(
    make_scene, make_flight
) -> None:
    flight = make_flight(du_px_per_ms=2.5, bright=False)
    windows = make_scene(flight, duration_us=80_000).windows()
    errors = {}
    for config in (auto_config(), paper_config()):
        detector = ReferenceDetector(config)
        found = [d for d in map(detector.step, windows) if d]
        off = [np.hypot(d.u_px - flight.centre(d.t_us)[0], d.v_px - flight.centre(d.t_us)[1]) for d in found]
        errors[config.polarity.leading_polarity] = np.median(off)
    assert errors["auto"] < 2.5 < 5.0 < errors["on"]


def test_the_stated_time_is_the_end_of_the_window_less_the_delay_on_both_paths(make_scene, make_flight) -> None:
    config = replace_setting(auto_config(), ("localise", "delay_us"), 430)
    scene = make_scene(make_flight(du_px_per_ms=2.5), duration_us=30_000)
    for detector in (ReferenceDetector(config), FastDetector(config)):
        ends = [(window.end_us, one.t_us) for window in scene.windows() if (one := detector.step(window)) is not None]
        assert len(ends) > 5 and all(t_us == end_us - 430 for end_us, t_us in ends)


def test_the_stages_are_in_order_and_each_gets_what_the_one_before_kept(
    make_scene, make_flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=20).windows()[5]
    monkeypatch.setattr("core.detection.pipeline.time.perf_counter", itertools.count().__next__)
    trace = trace_window(window, TrackState(), auto_config())
    assert [stage.name for stage in trace.stages] == STAGES
    assert trace.stages[0].count_in == len(window.events)
    for before, after in zip(trace.stages, trace.stages[1:], strict=False):
        assert after.count_in == before.count_out == len(before.events) and after.count_out <= after.count_in
    assert all(stage.seconds >= 1 for stage in trace.stages), "a second of this clock for each time that it is read"
    assert trace.detection is not None and trace.stage("localise").count_out > 0
    assert len(trace.labels) == trace.stage("denoise").count_out


def test_optional_stages_appear_when_they_are_enabled(make_scene) -> None:
    config = replace_setting(auto_config(), ("hot_pixels", "enabled"), True)
    config = replace_setting(config, ("flicker", "enabled"), True)
    trace = trace_window(make_scene().windows()[0], TrackState(), config)
    assert [stage.name for stage in trace.stages] == ["hot_pixels", "flicker", *STAGES]
    assert trace.state.hot_pixels is not None and trace.state.flicker is not None
    with pytest.raises(KeyError):
        trace_window(make_scene().windows()[0], TrackState(), auto_config()).stage("flicker")


def test_every_cluster_is_a_candidate_and_every_rejected_one_says_why(make_scene, make_flight) -> None:
    noisy = make_scene(make_flight(du_px_per_ms=0.8, r_px=18), noise_hz=40, duration_us=10_000).windows()
    plain = make_scene(make_flight(du_px_per_ms=2.5, r_px=14), make_flight(u_px=200, r_px=34)).windows()[5:20]
    everything = replace_setting(auto_config(), ("denoise", "kernel_px"), 1)
    seen = set()
    for window, config in [*((one, everything) for one in noisy), *((one, auto_config()) for one in plain)]:
        trace = trace_window(window, TrackState(), config)
        assert [one.label for one in trace.candidates] == list(range(trace.labels.max(initial=-1) + 1))
        for one in trace.candidates:
            assert (one.rejected is None) == (one.rejected_by is None)
            assert one.size == len(one.events) == (trace.labels == one.label).sum()
            assert (one.leading_events.on == one.leading_on).all()
            assert (one.shape is None) == (one.circle is None) == (not len(one.leading_events))
            seen.add(one.rejected_by)
    assert {"cluster", "polarity", "geometry", None} <= seen


def test_geometry_is_measured_even_for_a_cluster_that_is_too_small(make_scene, make_flight) -> None:
    config = replace_setting(auto_config(), ("cluster", "size_min"), 2000)
    window = make_scene(make_flight(du_px_per_ms=2.5)).windows()[5]
    rejected = [one for one in trace_window(window, TrackState(), config).candidates if one.rejected_by == "cluster"]
    measured = [one for one in rejected if len(one.leading_events)]
    assert measured and all(one.circle is not None and one.shape is not None for one in measured)
    assert all("events < 2000" in str(one.rejected) for one in rejected)


def test_after_a_detection_only_the_region_around_it_is_searched_and_three_misses_open_it_again(
    make_scene, make_flight
) -> None:
    config = auto_config()
    window = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=20).windows()[5]
    trace = trace_window(window, TrackState(), config)
    assert trace.roi is None and trace.detection is not None
    states = [trace.state]
    for number in range(3):
        start = window.end_us + 2000 * number
        empty = Window(Events.empty(window.events.sensor), start, start + 2000)
        trace = trace_window(empty, states[-1], config)
        assert trace.roi is not None and trace.detection is None
        states.append(trace.state)
    assert [state.misses for state in states] == [0, 1, 2, 0]
    assert states[2].centre_px is not None and states[3].centre_px is None


def test_of_two_balls_the_nearest_to_the_region_is_taken_and_the_other_counted(make_scene, make_flight) -> None:
    near, far = make_flight(u_px=60, v_px=60, du_px_per_ms=3), make_flight(u_px=60, v_px=110, du_px_per_ms=3)
    window = make_scene(near, far, noise_hz=0).windows()[10]
    for flight in (near, far):
        centre = flight.centre(window.start_us)
        trace = trace_window(
            window, TrackState(centre_px=centre), replace_setting(auto_config(), ("roi", "roi_expand_px"), 80.0)
        )
        assert trace.detection is not None and abs(trace.detection.v_px - flight.centre(window.end_us)[1]) < 5
        assert trace.extra_circles == 1


def test_moving_the_scene_moves_the_answer(make_scene, make_flight) -> None:
    events = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=0.5).windows()[5].events
    sensor = SensorSize(640, 480)
    answers = []
    for du, dv in ((0, 0), (301, 215)):
        moved = Events.from_columns(
            events.t_us, events.x_px.astype(int) + du, events.y_px.astype(int) + dv, events.on, sensor
        )
        answers.append(trace_window(Window(moved, 10_000, 12_000), TrackState(), auto_config()).detection)
    here, there = answers
    assert here is not None and there is not None
    assert (there.u_px - 301, there.v_px - 215, there.r_px) == pytest.approx(
        (here.u_px, here.v_px, here.r_px), abs=1e-3
    )


def test_the_order_of_events_of_one_moment_does_not_matter(make_scene, make_flight) -> None:
    events = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=5).windows()[5].events
    t_us = np.full(len(events), 10_000)
    order = np.random.default_rng(0).permutation(len(events))
    columns = events.x_px, events.y_px, events.on
    answers = []
    for rows in (np.arange(len(events)), order):
        shuffled = Events.from_columns(t_us, *(column[rows] for column in columns), events.sensor)
        answers.append(trace_window(Window(shuffled, 10_000, 12_000), TrackState(), paper_config()).detection)
    one, other = answers
    assert one is not None and other is not None
    assert (one.u_px, one.v_px, one.r_px) == pytest.approx((other.u_px, other.v_px, other.r_px), abs=1e-3)


def test_the_fast_labels_change_nothing_in_the_trace(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=5, duration_us=20_000).windows()
    for window in windows:
        plain = trace_window(window, TrackState(), auto_config())
        quick = trace_window(window, TrackState(), auto_config(), label_clusters=grid_labels)
        assert np.array_equal(plain.labels, quick.labels) and plain.detection == quick.detection
        assert [one.rejected for one in plain.candidates] == [one.rejected for one in quick.candidates]
