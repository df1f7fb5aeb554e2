"""The bench of many labels with few: every key goes through, and what is pressed is in the store."""

from __future__ import annotations

from pathlib import Path

from app.modes.label.keys import ACTS
from app.modes.label.labelling import DEFAULT_STEP_US
from benchmarks.app.many_labels import ANNOTATOR, LoneEditor, many_label_rows
from labels.model import LabelState
from labels.store import LabelStore, Layer


def test_every_key_is_measured(tmp_path: Path) -> None:
    (row,) = many_label_rows(tmp_path, labels=60, presses=2)
    assert row["unit"] == "ms" and 0 < row["measured"] < 5000
    assert f"{len(ACTS) + 1} keys" in row["note"]


def test_a_press_is_over_when_it_is_saved(tmp_path: Path) -> None:
    bench = LoneEditor(tmp_path, 60)
    try:
        bench.press(ACTS["no_ball"], 30 * DEFAULT_STEP_US)
        layer = Layer(bench.recording.uuid, "left", ANNOTATOR)
        found = LabelStore.read(tmp_path / "labels", layer).labels()
    finally:
        bench.close()
    assert len(found) == 60 and not bench.problems
    states = {label.t_us: label.state for label in LabelStore.read(tmp_path / "labels", layer).all()}
    assert [t_us for t_us, state in states.items() if state == LabelState.NO_BALL] == [30 * DEFAULT_STEP_US]
