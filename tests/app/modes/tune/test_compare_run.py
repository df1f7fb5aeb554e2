"""A comparison of methods, and what is said of it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from app.modes.tune.compare_panel import chart_titles, method_columns
from app.modes.tune.compare_run import (
    MAX_STRETCHES,
    CompareRequest,
    KnownReferences,
    comparison_html,
    known_reference,
    run_comparison,
    stretch_names,
    stretches_html,
)
from app.modes.tune.label_score import find_reference, labels_to_score, score_with_labels
from core.detection.methods import METHODS, method_config
from core.detection.window import EarlyEnds
from core.errors import CommandError
from core.metrics.compare import ErrorRun
from core.metrics.score import MATCH_RADIUS_PX
from core.recordings import CameraStream, open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore


class WithoutTruth:
    """A camera of which nothing is known."""

    truth = None

    def __init__(self, stream: CameraStream) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@pytest.fixture(scope="module")
def stream(serve_recording: Path):
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


def request_of(stream, labels: Path, *, agree_with=None, methods=("auto", "refined")) -> CompareRequest:
    return CompareRequest(
        recording="<serve>",
        uuid="u",
        stream=stream,
        configs=tuple((method, method_config(method)) for method in methods),
        slot="A",
        agree_with=agree_with,
        labels=labels,
        start_us=200_000,
        end_us=10_000_000,
        live=False,
    )


def run(request: CompareRequest):
    return run_comparison(request, progress=lambda share: None, cancelled=lambda: False)


def test_with_truth_the_curves_and_the_table_are_of_errors(stream, tmp_path: Path) -> None:
    answer = run(request_of(stream, tmp_path))
    assert (answer.kind, answer.nothing_known, len(answer.axis_s)) == ("truth", False, 40)
    assert answer.axis_s[0] == pytest.approx(0.205) and answer.axis_s[-1] == pytest.approx(0.595)
    columns = method_columns(answer)
    assert set(columns) == set(chart_titles(answer)) and all(len(curves) == len(METHODS) for curves in columns.values())
    shown = [method for method, curve in zip(METHODS, columns["recall"], strict=True) if np.isfinite(curve).any()]
    assert shown == ["auto", "refined"]
    said = comparison_html(answer)
    assert "<div style='overflow-x:auto;font-size:11px'><table>" in said, "the panel is narrow"
    assert "against the truth" in said and "agreement" not in said and "&lt;serve&gt;" in said
    assert "delay taken out: " in said and "live px" in said
    slower = run(dataclasses.replace(request_of(stream, tmp_path), added_us=8000.0))
    for one, late in zip(answer.methods, slower.methods, strict=True):
        now, then = one.judged.in_time, late.judged.in_time
        assert now is not None and then is not None
        assert then.age_median_us > now.age_median_us + 5000 and then.moved_median_px > now.moved_median_px
        assert then.held_median_px > then.moved_median_px


def test_where_nothing_is_known_it_is_agreement_with_refined_and_says_so(stream, tmp_path: Path) -> None:
    answer = run(request_of(WithoutTruth(stream), tmp_path, methods=("auto",)))
    assert (answer.kind, answer.reference, answer.nothing_known) == ("method", "refined", True)
    said = comparison_html(answer)
    assert "neither truth nor labels" in said and "agreement with refined, not error" in said
    assert answer.methods[0].judged.in_time is None and "live px" not in said
    assert "if refined is right" in stretches_html(answer, "auto", missed=True)
    assert chart_titles(answer)["error"] == "Distance from refined, px, median"


def test_a_chosen_method_is_the_reference_even_where_the_truth_is_known(stream, tmp_path: Path) -> None:
    answer = run(request_of(stream, tmp_path, agree_with="auto"))
    assert (answer.kind, answer.reference, answer.nothing_known) == ("method", "auto", False)
    auto, _ = answer.methods
    assert auto.judged.recall == 1.0 and auto.missed == auto.false == ()
    assert f">No misses at {len(auto.judged.asked_us)} times, if auto is right<" in stretches_html(
        answer, "auto", missed=True
    )
    assert f">None of {len(auto.judged.t_us)} answers are wrong" in stretches_html(answer, "auto", missed=False)


def test_without_truth_the_labels_of_whoever_made_most_are_right_but_for_hidden_balls(stream, tmp_path: Path) -> None:
    there = stream.truth.at([300_000, 302_000, 304_000])
    with LabelStore.open(tmp_path, "u", "left", "ann") as store:
        for t_us, u_px, v_px in zip(there.t_us.tolist(), there.u_px.tolist(), there.v_px.tolist(), strict=True):
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=u_px, y_px=v_px, r_px=6.0))
        store.put(Label(t_us=306_000, state=LabelState.OCCLUDED))
        store.put(Label(t_us=308_000, state=LabelState.NO_BALL))
    with LabelStore.open(tmp_path, "u", "left", "bob") as store:
        store.put(Label(t_us=300_000, state=LabelState.NO_BALL))
    reference = known_reference(tmp_path, "u", WithoutTruth(stream))
    assert reference is not None and (reference.kind, reference.name) == ("labels", "4 labels by ann")
    assert reference.asked_us.tolist() == [300_000, 302_000, 304_000]
    assert reference.places.t_us.tolist() == [300_000, 302_000, 304_000, 308_000]
    answer = run(request_of(WithoutTruth(stream), tmp_path))
    assert "against 4 labels by ann" in comparison_html(answer)
    assert [one.judged.recall for one in answer.methods] == [1.0, 1.0]
    early = dataclasses.replace(request_of(WithoutTruth(stream), tmp_path), ends=EarlyEnds(events=500))
    with pytest.raises(CommandError, match="labels are asked for whole windows"):
        run(early)


def test_labels_are_counted_as_the_score_counts_them(stream, tmp_path: Path) -> None:
    times = [300_300, 301_000, 303_700, 305_100]  # two closer to each other than a window, one far off, one wrong
    there = stream.truth.at(times)
    with LabelStore.open(tmp_path, "u", "left", "ann") as store:
        for t_us, u_px, v_px, off_px in zip(
            times, there.u_px.tolist(), there.v_px.tolist(), (0, 0, 20, 0), strict=True
        ):
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=u_px + off_px, y_px=v_px, r_px=6.0))
        store.put(Label(t_us=times[-1], state=LabelState.NO_BALL))
    answer = run(request_of(WithoutTruth(stream), tmp_path))
    for one in answer.methods:
        reference = find_reference(tmp_path, "u", "left")
        assert reference is not None
        score = score_with_labels(
            *(tmp_path, reference, stream, one.method, method_config(one.method), 0),
            progress=lambda share: None,
            cancelled=lambda: False,
        )
        at_8_px = score.groups[0].at[-1]
        assert at_8_px.tolerance_px == MATCH_RADIUS_PX
        assert (one.judged.recall, one.judged.precision) == pytest.approx((at_8_px.recall, at_8_px.precision))
        assert one.judged.recall == pytest.approx(2 / 3) and one.judged.precision == 0.5
        assert one.judged.error_at(50) == pytest.approx(score.groups[0].median_px)
        assert [stretch.start_us for stretch in one.missed] == [303_700]
        assert len(one.judged.run.step_s) == len(times)


def test_score_and_compare_take_the_truth_of_a_simulated_camera_even_if_it_is_labelled(stream, tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, "u", "left", "ann") as store:
        store.put(Label(t_us=300_300, state=LabelState.VISIBLE, x_px=10.0, y_px=10.0, r_px=6.0))
    assert labels_to_score(tmp_path, "u", stream) is None
    assert run(request_of(stream, tmp_path, methods=("refined",))).reference == "the truth"
    for asked in (labels_to_score(tmp_path, "u", stream, "ann"), labels_to_score(tmp_path, "u", WithoutTruth(stream))):
        assert asked is not None and asked.layer.annotator == "ann"


class Forgets(WithoutTruth):
    """A camera whose events can be read once."""

    def __init__(self, stream: CameraStream) -> None:
        super().__init__(stream)
        self.slices: list[tuple[int, int]] = []

    def slice(self, start_us: int, end_us: int) -> object:
        self.slices.append((start_us, end_us))
        assert len(self.slices) == 1
        return self._stream.slice(start_us, end_us)


def test_every_method_sees_the_events_that_a_live_camera_had_at_first(stream, tmp_path: Path) -> None:
    kept = request_of(stream, tmp_path, agree_with="auto")
    forgets = Forgets(stream)
    live = run(dataclasses.replace(kept, stream=forgets, live=True))
    assert forgets.slices == [(140_000, 600_000)]
    assert [one.judged.recall for one in live.methods] == [one.judged.recall for one in run(kept).methods]


def test_a_part_without_events_is_refused(stream, tmp_path: Path) -> None:
    late = dataclasses.replace(request_of(stream, tmp_path), start_us=700_000)
    with pytest.raises(CommandError, match="no events"):
        run(late)


def test_names_of_stretches_are_in_order_and_not_too_many() -> None:
    many = tuple(ErrorRun(1000 * k, 1000 * k + 500, 1 + k % 3, 1000 * k, (0.0, 0.0)) for k in range(MAX_STRETCHES + 9))
    names = stretch_names(many)
    assert len(names) == MAX_STRETCHES and list(names) == sorted(names)
    assert names["0.0020 s ×3"] == many[2] and sum(one.count == 3 for one in names.values()) == 16
    assert stretch_names(()) == {}


def test_buttons_are_said_to_be_what_they_are(stream, tmp_path: Path) -> None:
    answer = run(request_of(stream, tmp_path))
    auto, refined = answer.methods
    for one in (auto, refined):
        missed = sum(stretch.count for stretch in one.missed)
        assert f"Missed at {missed} of {len(one.judged.asked_us)} times" in stretches_html(
            answer, one.method, missed=True
        )
        false = sum(stretch.count for stretch in one.false)
        assert f"{false or 'None'} of {len(one.judged.t_us)} answers" in stretches_html(
            answer, one.method, missed=False
        )


def test_labels_are_read_once_until_somebody_may_have_made_more(stream, tmp_path: Path) -> None:
    known, unknown = KnownReferences(), WithoutTruth(stream)
    assert known.find(tmp_path, "u", unknown) is None
    with LabelStore.open(tmp_path, "u", "left", "ann") as store:
        store.put(Label(t_us=300_000, state=LabelState.VISIBLE, x_px=7.0, y_px=8.0))
    assert known.find(tmp_path, "u", unknown) is None
    known.clear()
    found = known.find(tmp_path, "u", unknown)
    assert found is not None and found.places.u_px.tolist() == [7.0]
    truth = known.find(tmp_path, "u", stream)
    assert truth is not None and truth.kind == "truth" and truth.places is stream.truth
