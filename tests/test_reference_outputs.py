"""What is computed from stored files is what it was, and the comparison of reference outputs says what is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reference_arrays import (
    EXACT,
    Arrays,
    Tolerance,
    difference,
    differences,
    read_outputs,
    text_columns,
    write_outputs,
)
from tests.reference_computations import Bench
from tests.reference_outputs import OUTPUTS, compare

pytestmark = pytest.mark.numeric
FILE = Path(__file__).parent / "fixtures" / "reference-outputs.npz"
GUARDED = {name: output.guarded for name, output in OUTPUTS.items() if output.guarded is not None}


@pytest.fixture(scope="module")
def stored() -> dict[str, Arrays]:
    """Reference outputs of an earlier version."""
    return read_outputs(FILE)[0]


@pytest.mark.parametrize("name", GUARDED)
def test_what_is_computed_from_stored_files_is_what_it_was(name: str, stored: dict, tmp_path: Path) -> None:
    """To rounding, as another machine may run this; `python -m tests.reference_outputs compare` is exact."""
    assert differences(stored[name], OUTPUTS[name].compute(Bench(tmp_path)), GUARDED[name]) == []


def test_every_guarded_output_has_a_reference(stored: dict) -> None:
    assert list(stored) == list(GUARDED)


def test_the_same_array_is_the_same_and_a_rounding_error_is_small() -> None:
    values = np.linspace(0, 1, 100)
    values[:2] = np.nan, np.inf
    assert difference(values, values.copy(), EXACT) is None
    rounded = values + 1e-12
    assert difference(values, rounded, Tolerance()) is None
    assert difference(values, rounded, EXACT) == "98 of 100 values differ, by up to 1e-12"
    assert difference(values, values + 1e-3, Tolerance()) is not None
    assert difference(values, np.nan_to_num(values), Tolerance()) is not None, "a number where there was none"
    assert difference(values[:0], values[:0], EXACT) is None


def test_a_few_pixels_may_be_others_where_that_is_allowed() -> None:
    picture = np.zeros(1000, np.uint8)
    other = picture.copy()
    other[0] = 255
    assert difference(picture, other, Tolerance()) == "1 of 1000 values differ, by up to 255"
    assert difference(picture, other, Tolerance(share=1e-3)) is None


def test_other_lengths_types_bytes_and_names_are_differences(tmp_path: Path) -> None:
    before = {"a": np.arange(5), "b": np.arange(5), "c": np.arange(5, dtype=np.uint8), "d": np.array([b"x"])}
    now = {"a": np.arange(6), "b": np.arange(5.0), "c": np.arange(1, 6, dtype=np.uint8), "e": np.arange(5)}
    name = next(iter(GUARDED))
    write_outputs(tmp_path / "kept.npz", {name: before}, {"processor": "any"})
    kept, machine = read_outputs(tmp_path / "kept.npz")
    assert machine == {"processor": "any"}
    ((_, words),) = compare(kept, {name: now})
    assert words.splitlines() == [
        "d: is gone",
        "e: is new",
        "a: <i8 [5] -> <i8 [6]",
        "b: <i8 [5] -> <f8 [5]",
        "c: 5 of 5 values differ, by up to 1",
    ]
    assert compare(kept, {name: before}) == [(name, "equal")]
    assert compare(kept, {"else": before}) == [("else", "not in the file")]
    rounded = {"a": np.array([0.1])}, {"a": np.array([0.1 + 1e-12])}
    ((_, words),) = compare({name: rounded[0]}, {name: rounded[1]})
    assert words.splitlines()[0] == "equal but for rounding"


def test_the_numbers_of_a_text_are_told_from_its_words() -> None:
    found = text_columns("t", "x -1.5, y 2e-3 px")
    assert bytes(found["t: words"]) == b"x #, y # px"
    assert found["t: numbers"].tolist() == [-1.5, 0.002]
