"""The score of a detector's config against the labels of a camera, as Tune shows it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from app.formatting import html_text, share_text, table_row, with_dashes_explained
from core.detection import DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.metrics.at_times import answers_at
from core.metrics.run import TimedDetector
from core.recordings import CameraStream
from core.text import counted
from labels.agreement import Agreement, measure_agreement
from labels.arrays import STATES
from labels.model import LabelState
from labels.score import GroupScore, answers_in_time, score_groups
from labels.score_picture import ScoreCurves, measure_curves, score_svg
from labels.store import LabelStore, Layer, find_layers, has_labels

SHOWN_PX: Final = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, slots=True, eq=False)
class LabelScore:
    """How good a config is, measured on one annotator's labels."""

    annotator: str
    labels: int
    groups: tuple[GroupScore, ...]
    curves: ScoreCurves
    in_time: tuple[GroupScore, ...]
    """All labels with the newest answers that have arrived by then: held, and moved on. Nothing without labels."""
    noise: Agreement | None
    """Label noise from the annotator's repeated labels, px per coordinate; None without any."""


class ScoreCancelledError(Exception):
    """The score was cancelled."""


def find_reference(folder: Path, recording_uuid: str, camera: str, annotator: str | None = None) -> LabelStore | None:
    """The labels of an annotator, or of the one who has made the most in this camera; None without any."""
    stores = [
        LabelStore.read(folder, layer)
        for layer in find_layers(folder, recording_uuid)
        if layer.camera == camera and not layer.blind and annotator in (None, layer.annotator)
    ]
    best = max(stores, key=lambda store: len(store.labels()), default=None)
    return best if best is not None and len(best.labels()) else None


def labels_to_score(
    folder: Path, recording_uuid: str, stream: CameraStream, annotator: str | None = None
) -> LabelStore | None:
    """The labels that Score and Compare over time take as the reference of a camera; None where they take none.

    Labels of an annotator who is named; else those of the one who has made the most, but none where the truth is known:
    the truth of a simulated camera is complete, and both then count the same balls.
    """
    if annotator is None and stream.truth is not None:
        return None
    return find_reference(folder, recording_uuid, stream.name, annotator)


def score_with_labels(
    folder: Path,
    reference: LabelStore,
    stream: CameraStream,
    method: Method,
    config: DetectorConfig,
    added_us: int,
    *,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> LabelScore:
    """Run a method with a config at every label and score it; `added_us` is what answers take besides computing.

    Raises:
        ScoreCancelled: when `cancelled()` becomes true.
    """
    labels = reference.labels()
    # No detector can be right or wrong about a ball that nobody sees.
    asked = labels.rows(labels.state != STATES.index(LabelState.OCCLUDED))

    def report(share: float) -> None:
        if cancelled():
            raise ScoreCancelledError
        progress(share)

    detector = TimedDetector(make_detector(method, stream.sensor, config))
    window_us = method_config(method, config).window.window_us
    answers = answers_at(stream, detector, asked.t_us, window_us, progress=lambda share: report(share / 2))
    later = answers_in_time(
        stream, detector, answers, window_us, added_us, progress=lambda share: report(0.5 + share / 2)
    )
    late = f"all, {1e-3 * later.delay_us:.2f} ms later"
    in_time = [
        replace(score_groups(found, asked)[0], group=f"{late}, {name}")
        for name, found in (("as given", later.held), ("extrapolated", later.moved))
        if len(asked)
    ]
    return LabelScore(
        annotator=reference.layer.annotator,
        labels=len(labels),
        groups=score_groups(answers, asked),
        curves=measure_curves(answers, asked),
        in_time=tuple(in_time),
        noise=_own_noise(folder, reference),
    )


def label_score_html(title: str, score: LabelScore) -> str:
    """HTML of the score: a table of the groups, and the picture."""
    titles = ("", "labels", *(f"P / R at {px:g} px" for px in SHOWN_PX), "median", "p95", "along", "across")
    head = "".join(f"<th style='text-align:left;font-weight:500;padding-right:14px'>{name}</th>" for name in titles)
    rows = "".join(_row(group) for group in (*score.groups, *score.in_time))
    noise = score.noise.by_hand.sigma_px if score.noise is not None and score.noise.by_hand.pairs else None
    noise_text = "not measured" if noise is None else f"{noise:.2f} px a coordinate"
    table = with_dashes_explained(f"<table>{head}{rows}</table>")
    against = f"against {counted(score.labels, 'label')} by"
    svg = score_svg(score.curves, f"{title}, {against} {score.annotator}", noise_px=noise)
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{html_text(title)}, {against} "
        f"{html_text(score.annotator)}; annotator noise: {noise_text}"
        f"{table}<div style='margin-top:6px'>{svg}</div></div>"
    )


def _row(group: GroupScore) -> str:
    cells = (
        group.group,
        group.labels,
        *(f"{share_text(at.precision)} / {share_text(at.recall)}" for at in group.at),
        _figure(group.median_px, ".2f", " px"),
        _figure(group.p95_px, ".2f", " px"),
        _figure(group.along_px, "+.2f", " px"),
        _figure(group.across_px, "+.2f", " px"),
    )
    return table_row(cells, "padding-right:14px", row_style="white-space:nowrap")


def _figure(value: float, form: str, unit: str = "") -> str:
    """Format a figure; a dash where there is none."""
    return f"{value:{form}}{unit}" if math.isfinite(value) else "-"


def _own_noise(folder: Path, store: LabelStore) -> Agreement | None:
    first = store.layer
    layer = Layer(first.recording_uuid, first.camera, first.annotator, blind=True)
    if not has_labels(folder, layer):
        return None
    return measure_agreement(*(one.independent().labels for one in (store, LabelStore.read(folder, layer))))
