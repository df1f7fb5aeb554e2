"""The parts of `bench app --soak`: what it counts is there, and it finds what grows or is lost."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import Visitor
from benchmarks.app.bench_soak import RECORDING, Annotator, Samples, SharedRecording, count_labels, label_together
from benchmarks.app.served_app import ProcessUsage, children_of, usage_of
from core.cameras import stereo_preset
from core.errors import CommandError
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from labels.model import Label, LabelState
from labels.store import LabelStore, find_layers

PEOPLE = 3


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[App]:
    workspace = Workspace(tmp_path)
    simulate_recording(
        workspace.recording_path(RECORDING),
        StereoConfig(sensor=SensorConfig()),
        stereo_preset(),
        [LaunchConfig()],
        seed=1,
    )
    lab = App(workspace, Library(workspace), RECORDING, host="127.0.0.1", port=0)
    yield lab
    lab.stop()


def test_people_who_label_at_once_lose_nothing_and_stay_at_their_own_times(lab: App, tmp_path: Path) -> None:
    whole = SharedRecording.of(tmp_path / "recordings" / f"{RECORDING}.h5")
    shared = replace(whole, steps=4 * PEOPLE)  # each has three times of its own, and the first one again
    visitors = [Visitor(lab.port) for _ in range(PEOPLE)]
    try:
        annotators = [Annotator(visitor, shared, number, PEOPLE) for number, visitor in enumerate(visitors)]
        for annotator in annotators:
            annotator.begin()
        label_together(annotators, 4)
    finally:
        for visitor in visitors:
            visitor.close()
    labels = tmp_path / "labels"
    counts = count_labels(labels, shared, annotators)
    assert (counts.wanted, counts.lost, counts.wrong) == (3 * PEOPLE, 0, 0) and whole.steps > 30
    (layer,) = (layer for layer in find_layers(labels) if layer.annotator == annotators[0].name)
    first, second, *_ = sorted(annotators[0].times_us)
    with LabelStore.open(labels, layer.recording_uuid, layer.camera, layer.annotator) as store:
        store.edit(put=[Label(t_us=first + 1, state=LabelState.NO_BALL)], delete=[first, second])
    counts = count_labels(labels, shared, annotators)
    assert (counts.lost, counts.wrong) == (2, 1)


def test_growth_is_seen_and_a_step_at_the_beginning_is_not_growth() -> None:
    grows, steady = Samples(), Samples()
    for number in range(90):
        for samples, mb in ((grows, 100 + number / 10), (steady, 500.0 if number < 30 else 700.0)):
            samples.at_s.append(10.0 * number)
            samples.usages.append(ProcessUsage(mb, 20 + (number > 58), 8 + number % 2))
    assert grows.growth_mb_per_h() == pytest.approx(36.0)
    assert steady.growth_mb_per_h() == 0
    assert grows.more(lambda usage: usage.threads) == 1 and grows.more(lambda usage: usage.handles) == 0


HOLDER = f"""
import os, sys, threading
print("begun", flush=True)
sys.stdin.readline()
threading.Thread(target=threading.Event().wait, daemon=True).start()
file, kept = open({os.devnull!r}), bytearray(b"1" * 30_000_000)
print("held", flush=True)
sys.stdin.readline()
"""


def test_what_a_process_holds_is_counted() -> None:
    command = [sys.executable, "-c", HOLDER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdin is not None and holder.stdout is not None
        assert holder.stdout.readline() == "begun\n"
        before = usage_of(holder.pid)
        holder.stdin.write("\n")
        holder.stdin.flush()
        assert holder.stdout.readline() == "held\n"
        after = usage_of(holder.pid)
    assert after.threads == before.threads + 1 and after.handles == before.handles + 1
    assert 20 < after.resident_mb - before.resident_mb < 60


def test_a_child_is_found_and_one_that_is_gone_is_told() -> None:
    child = subprocess.Popen(["sleep", "60"])
    try:
        assert child.pid in children_of(os.getpid())
    finally:
        child.kill()
        child.wait()
    with pytest.raises(CommandError, match="cannot see what a process holds"):
        usage_of(child.pid)
