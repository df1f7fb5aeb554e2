"""What is computed from stored files is what it was, and the comparison of reference outputs says what is not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.reference_arrays import compare, difference, is_close, summarise, text_columns
from tests.reference_computations import Bench
from tests.reference_outputs import OUTPUTS

FILE = Path(__file__).parent / "fixtures" / "reference-outputs.json"


@pytest.fixture(scope="module")
def stored() -> dict:
    """Reference outputs of an earlier version."""
    return json.loads(FILE.read_text(encoding="utf-8"))["outputs"]


@pytest.mark.parametrize("name", [name for name, output in OUTPUTS.items() if output.stored])
def test_what_is_computed_from_stored_files_is_what_it_was(name: str, stored: dict, tmp_path: Path) -> None:
    """To rounding, as another machine may run this; `python -m tests.reference_outputs compare` is exact."""
    found = OUTPUTS[name].compute(Bench(tmp_path))
    assert sorted(found) == sorted(stored[name])
    assert [key for key, array in found.items() if not is_close(stored[name][key], array)] == []


def test_every_output_has_a_reference(stored: dict) -> None:
    assert list(stored) == list(OUTPUTS)


def test_the_same_array_is_the_same_and_a_rounding_error_is_small() -> None:
    values = np.linspace(0, 1, 100)
    values[0] = np.nan
    kept = json.loads(json.dumps(summarise(values)))
    assert difference(kept, values) is None
    rounded = values + 1e-12
    assert is_close(kept, rounded) and "by up to 1e-12" in str(difference(kept, rounded))
    assert difference(kept, rounded, before=values) == "99 of 100 values differ, by up to 1e-12"
    assert not is_close(kept, values + 1e-3)


def test_other_lengths_types_bytes_and_names_are_differences() -> None:
    before = {"a": np.arange(5), "b": np.arange(5), "c": np.arange(5, dtype=np.uint8), "d": np.arange(5)}
    now = {"a": np.arange(6), "b": np.arange(5.0), "c": np.arange(1, 6, dtype=np.uint8), "e": np.arange(5)}
    kept = {"one": {name: summarise(array) for name, array in before.items()}}
    ((name, words),) = compare(kept, {"one": now}, {})
    assert name == "one"
    assert words.splitlines() == [
        "d: is gone",
        "e: is new",
        "a: <i8 [5] -> <i8 [6]",
        "b: <i8 [5] -> <f8 [5]",
        "c: other bytes",
    ]
    assert not any(is_close(kept["one"][key], now[key]) for key in "abc")
    assert compare(kept, {"one": before}, {}) == [("one", "equal")]


def test_the_numbers_of_a_text_are_told_from_its_words() -> None:
    found = text_columns("t", "x -1.5, y 2e-3 px")
    assert bytes(found["t: words"]) == b"x #, y # px"
    assert found["t: numbers"].tolist() == [-1.5, 0.002]
