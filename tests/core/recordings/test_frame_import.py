"""Pictures of a folder, in the order in which they were taken."""

from __future__ import annotations

import numpy as np
import pytest

from core.recordings.frame_import import picture_files


@pytest.mark.parametrize(
    "names",
    [
        ["1.png", "2.png", "10.png", "100.png"],
        ["frame_000009.png", "frame_000010.png", "frame_000011.png"],
        ["cam1_frame2.jpg", "cam1_frame10.jpg", "cam2_frame1.jpg"],
        ["a.png", "b.png", "b02.png", "b2.png", "b10.png"],  # of one value: by their letters
        ["1.5.png", "1.25.png"],  # parts of a version or a date, not a fraction
    ],
)
def test_numbers_in_names_are_in_order_of_their_value(tmp_path, names):
    for place in np.random.default_rng(0).permutation(len(names)):
        (tmp_path / names[place]).touch()
    found = [path.name for path in picture_files(tmp_path, (".png", ".jpg"))]
    assert found == names


def test_what_is_hidden_or_no_picture_is_left_out(tmp_path):
    for name in ("._1.png", "1.png", "notes.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in picture_files(tmp_path, (".png",))] == ["1.png"]
