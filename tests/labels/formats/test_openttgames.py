"""The published layout of OpenTTGames, as its authors and those who train on it read it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.model import ContactKind, ContactLabel, LabelState

KIND = FORMATS["openttgames"]
FRAMES_US = np.arange(0, 1_000_000, 8_333)


@pytest.fixture
def clip(context: ImportContext) -> ImportContext:
    """Pictures of 1920x1080 at 120 Hz."""
    return dataclasses.replace(context, frame_times_us=FRAMES_US, picture_size=(1920, 1080))


def write(folder: Path, ball: object, events: object) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ball_markup.json").write_text(json.dumps(ball))
    (folder / "events_markup.json").write_text(json.dumps(events))


def test_the_published_markup_gives_balls_and_contacts_at_the_times_of_their_pictures(
    clip: ImportContext, tmp_path: Path
) -> None:
    ball = {"14": {"x": 960, "y": 540}, "15": {"x": -1, "y": -1}}
    write(tmp_path / "game_1", ball, {"14": "bounce", "20": "net", "30": "empty_event"})
    found = KIND.read(tmp_path, clip)
    assert found.rejections == ()
    assert [(label.t_us, label.state) for label in found.labels] == [
        (FRAMES_US[14], LabelState.VISIBLE),
        (FRAMES_US[15], LabelState.NO_BALL),
    ]
    width, height = clip.sensor.width_px, clip.sensor.height_px
    assert found.labels[0].x_px == pytest.approx(960.5 * width / 1920 - 0.5)
    assert found.labels[0].y_px == pytest.approx(540.5 * height / 1080 - 0.5)
    assert [(one.t_us, one.kind) for one in found.contacts] == [
        (FRAMES_US[14], ContactKind.BOUNCE),
        (FRAMES_US[20], ContactKind.NET),
    ]


@pytest.mark.parametrize(
    ("ball", "events", "says"),
    [
        ({"14": {"x": 960}}, {}, "missing 'y'"),
        ({"14": {"x": 960, "y": -1}}, {}, "outside the picture"),
        ({"x14": {"x": 1, "y": 1}}, {}, "the number of a picture"),
        ({"999999": {"x": 1, "y": 1}}, {}, "no such frame"),
        ({}, {"14": "smash"}, "unknown event"),
        ([], {}, "not a file of OpenTTGames"),
    ],
)
def test_what_is_no_markup_is_rejected_with_the_reason(
    clip: ImportContext, tmp_path: Path, ball: object, events: object, says: str
) -> None:
    write(tmp_path, ball, events)
    found = KIND.read(tmp_path, clip)
    assert found.labels == () and found.contacts == ()
    assert len(found.rejections) == 1 and says in str(found.rejections[0])


def test_two_games_in_one_folder_number_the_same_pictures(clip: ImportContext, tmp_path: Path) -> None:
    for game in ("game_1", "game_2"):
        write(tmp_path / game, {"14": {"x": 960, "y": 540}}, {})
    assert "same pictures" in str(KIND.read(tmp_path, clip).rejections[0])


def test_a_picture_that_stands_twice_is_told(clip: ImportContext, tmp_path: Path) -> None:
    write(tmp_path, {}, {})
    (tmp_path / "ball_markup.json").write_text('{"14": {"x": 1, "y": 1}, "14": {"x": 2, "y": 2}}')
    found = KIND.read(tmp_path, clip)
    assert len(found.labels) == 1 and "twice" in str(found.rejections[0])


def test_hits_are_a_loss_and_the_files_are_as_others_read_them(balls: LabelSet, tmp_path: Path) -> None:
    contacts = tuple(ContactLabel(t_us=100 + 2 * row, kind=kind) for row, kind in enumerate(ContactKind))
    made = KIND.write(dataclasses.replace(balls, contacts=contacts), tmp_path, ExportOptions())
    ball, events = (json.loads(file.read_text()) for file in made.files[:2])
    assert [file.name for file in made.files] == ["ball_markup.json", "events_markup.json", "frames.csv"]
    assert sorted(events.values()) == ["bounce", "net"] and any("hit" in loss for loss in made.losses)
    assert len(ball) == len(balls.labels) and all(set(entry) == {"x", "y"} for entry in ball.values())
