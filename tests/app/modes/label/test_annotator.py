from __future__ import annotations

from pathlib import Path

import pytest

from app.modes.label.annotator import LONGEST_NAME, annotator_from, last_annotator, remember_annotator
from app.modes.label.labelling import DEFAULT_ANNOTATOR
from core.errors import CommandError


@pytest.mark.parametrize(
    ("typed", "name"), [("Anna", "anna"), ("  Carla K ", "carla-k"), ("bea_2", "bea_2"), ("../../etc", "etc")]
)
def test_a_name_is_small_letters_digits_and_dashes(typed: str, name: str) -> None:
    assert annotator_from(typed) == name


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("", "a name is missing"),
        ("...", "not a usable name"),
        ("an\0na", "nobody sees"),
        ("an\u202ena", "nobody sees"),
        ("an\nna", "nobody sees"),
        ("x" * (LONGEST_NAME + 1), "too long"),
    ],
)
def test_a_name_that_cannot_be_used_is_one_clear_line(typed: str, message: str) -> None:
    with pytest.raises(CommandError, match=message) as error:
        annotator_from(typed)
    assert "\n" not in str(error.value)


def test_the_name_that_was_used_last_is_offered_to_the_next(tmp_path: Path) -> None:
    assert last_annotator(tmp_path) == DEFAULT_ANNOTATOR
    remember_annotator(tmp_path, "anna")
    assert last_annotator(tmp_path) == "anna"
    (tmp_path / "last-annotator.txt").write_bytes(b"\xff\xfe\0")
    assert last_annotator(tmp_path) == DEFAULT_ANNOTATOR
