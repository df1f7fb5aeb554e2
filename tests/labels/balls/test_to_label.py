"""The list of moments to label: by recording, in order; a file that is none is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import LabelError
from labels.balls.to_label import FILE, read_moments, write_moments


def test_a_list_is_read_by_recording_and_replaced_by_the_next(tmp_path: Path) -> None:
    assert read_moments(tmp_path, "a") == ()
    write_moments(tmp_path, {"a": [2**53 + 1, 5, 5], "b": [7]})
    assert read_moments(tmp_path, "a") == (5, 2**53 + 1) and read_moments(tmp_path, "b") == (7,)
    write_moments(tmp_path, {"b": [8]})
    assert read_moments(tmp_path, "a") == () and read_moments(tmp_path, "b") == (8,)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"format": "other", "moments_us": {"a": [1]}}',
        '{"format": "rallyscope-to-label", "moments_us": {"a": [true]}}',
        '{"format": "rallyscope-to-label", "moments_us": {"a": 3}}',
    ],
)
def test_what_is_no_list_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(LabelError, match="not a list of moments"):
        read_moments(tmp_path, "a")
