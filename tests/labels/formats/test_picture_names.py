"""Which number a picture's name tells, over all names of an import; None: it does not tell, and is refused."""

from __future__ import annotations

import pytest

from core.errors import LabelError
from labels.formats.picture_names import PictureNumbers, other_camera_in, own_time, stem_of

UUIDS = (
    "550e8400-e29b-41d4-a716-446655440000.png",
    "6fa459ea-ee8a-3ca4-894e-000000000012.png",
    "12345678-1234-1234-1234-000000000007.png",
)
CASES = [
    # one number that varies
    (["frame_000000.PNG", "frame_000012.PNG"], [0, 12]),
    (["a/b/0001.jpg", "a/b/0002.jpg"], [1, 2]),
    ([r"C:\data\frame_7.bmp"], [7]),
    (["video_000123.txt", "video_000124.txt"], [123, 124]),
    (["frame_000003"], [3]),
    (["rally.cam9.frame_000003"], [3]),
    # what tools put before and behind
    (["frame_000003_png.rf.0a1b2c3d4e5f60718293a4b5c6d7e8f9.txt"], [3]),
    (["frame_000003_jpg.rf.12345678901234567890123456789012.jpg"], [3]),
    (["1a2b3c4d-frame_000004.png", "99887766-frame_000005.png"], [4, 5]),
    (["1a2b3c4d__frame_000004.png"], [4]),
    (["images%2Ftrain%2Fframe_000008.png"], [8]),
    (["..%5C..%5Cmedia%5Cupload%5C1%5C0a0b0c0d-frame_000009.png"], [9]),
    # sizes, dates, dots
    (["frame_000003_1280x720.png"], [3]),
    (["frame_000003_1280_720.png", "frame_000004_1280_720.png"], [3, 4]),
    (["000123_1280_720.png", "000124_1280_720.png"], [123, 124]),
    (["rally3_000123.png", "rally3_000124.png"], [123, 124]),
    (["20240101_000001.png", "20240101_000002.png"], [1, 2]),
    (["cam1_000005.png"], [5]),
    # hashes and nothing else
    (list(UUIDS), [None] * 3),
    ([UUIDS[2]], [None]),
    (["0a1b2c3d4e5f60718293a4b5c6d7e8f9.png"], [None]),
    (["ab12cd.png", "ef34ab.png", "123456.png"], [None] * 3),
    (["picture.png"], [None]),
    # several numbers, none of which is known to count
    (["1_2.png", "2_1.png"], [None, None]),
    (["rally_3_of_5.png"], [None]),
    # two cameras, two rallies, two ways of naming
    (["cam1_000005.png", "cam2_000005.png"], [None, None]),
    (["cam1.png", "cam2.png", "cam3.png"], [None] * 3),
    (["cam1_frame_000005.png", "cam2_frame_000006.png"], [None, None]),
    (["rally1_000005.png", "rally2_000006.png"], [None, None]),
    (["left_3.png", "right_3.png", "right_4.png"], [None] * 3),
    (["000000.txt", "000005.txt", "frame_000000.txt", "frame_000001.txt"], [None] * 4),
]


@pytest.mark.parametrize(("names", "expected"), CASES, ids=[names[0][:30] for names, _ in CASES])
def test_a_number_counts_only_if_the_names_together_tell_it(names: list[str], expected: list[int | None]) -> None:
    numbers = PictureNumbers(names)
    found: list[int | None] = []
    for name in names:
        try:
            found.append(numbers.number_of(name))
        except LabelError:
            found.append(None)
    assert found == expected


@pytest.mark.parametrize(
    "names",
    [
        ("left/frame_1.png", "right/frame_1.png"),
        ("frame_1_png.rf.aaaabbbbccccdddd.jpg", "frame_1_png.rf.bbbbaaaaddddcccc.jpg"),
        ("train/camera_t000000010000us.txt", "train/camera_t000000010000us_png.rf.0a1b2c.txt"),
        ("1a2b3c4d-frame_1.png", "ffff3c4d-frame_1.png"),
    ],
)
def test_two_pictures_with_one_name_are_refused(names: tuple[str, str]) -> None:
    numbers = PictureNumbers(names)
    for name in names:
        with pytest.raises(LabelError, match="several pictures have this name"):
            numbers.refuse_copies(name)


def test_a_label_file_and_its_picture_are_no_copies() -> None:
    PictureNumbers(["a/frame_1.png", "a/frame_1.txt"]).refuse_copies("a/frame_1.png")


def test_our_own_time_survives_what_tools_do_to_a_name() -> None:
    for name in (
        "links%2F%C3%A9%2E1_t000000030000us.png",
        "camera_t000000030000us_png.rf.0a1b2c3d4e5f.jpg",
        "0a0b0c0d-camera_t000000030000us.png",
        "camera_t000000030000us_1280x720.txt",
    ):
        assert own_time(stem_of(name)) == 30_000, name
    assert own_time(stem_of("a_t000000030000us_t000000040000us.png")) is None


@pytest.mark.parametrize(
    ("picture", "other"),
    [
        ("right_t000000010000us.png", "right"),
        ("left_t000000010000us.png", None),
        ("right/frame_1.png", "right"),
        ("frame_right_1.png", "right"),
        ("left_of_right/frame_1.png", None),
        ("brighter/frame_1.png", None),
    ],
)
def test_pictures_of_another_camera_are_told_by_a_word_of_their_name(picture: str, other: str | None) -> None:
    assert other_camera_in(picture, "left", ("right",)) == other
