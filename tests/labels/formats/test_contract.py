"""What every exchange format has to do."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from core.files import PREFIX
from labels.formats import FORMATS, ExportOptions, ImportContext, LabelFormat, LabelSet
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource, Provenance
from tests.labels.formats.damaged_exchange import damage_and_read

WORST_ERROR_PX = {
    "voc": 0.0,
    "yolo": 0.01,
    "yolo-pose": 0.01,
    "coco": 0.01,
    "label-studio": 0.0,
    "tracknet": 0.71,
    "cvat": 0.01,
    "csv": 0.0,
    "hdf5": 0.0,
    "json": 0.0,
    "openttgames": 0.71,
    "sony": 0.0,
}
EXACT = ("csv", "hdf5", "json")
KEEPS_STATES = ("voc", "coco", "cvat", "csv", "hdf5", "json", "label-studio", "sony")


@pytest.fixture(params=sorted(FORMATS))
def kind(request: pytest.FixtureRequest) -> LabelFormat:
    return FORMATS[request.param]


def target(kind: LabelFormat, folder: Path) -> Path:
    return folder / "labels.h5" if kind.name == "hdf5" else folder / "größe 1"


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def without_provenance(label: Label) -> Label:
    return dataclasses.replace(label, provenance=Provenance(), covariance_px2=None)


def test_whole_balls_come_back_where_they_were(
    kind: LabelFormat, balls: LabelSet, context: ImportContext, tmp_path: Path
) -> None:
    written = kind.write(balls, target(kind, tmp_path), ExportOptions())
    assert written.files and all(file.is_file() for file in written.files)
    imported = kind.read(target(kind, tmp_path), context)
    assert imported.rejections == ()
    assert [label.t_us for label in imported.labels] == [label.t_us for label in balls.labels]
    assert [label.state for label in imported.labels] == [label.state for label in balls.labels]
    errors = [
        np.hypot(back.x_px - label.x_px, back.y_px - label.y_px)  # type: ignore[operator]
        for back, label in zip(imported.labels, balls.labels, strict=True)
        if label.x_px is not None
    ]
    assert len(errors) == 200
    assert max(errors) <= WORST_ERROR_PX.get(kind.name, 0.01)
    if kind.name not in ("tracknet", "openttgames"):
        radii = [(back.r_px, label.r_px) for back, label in zip(imported.labels, balls.labels, strict=True)]
        assert all(label == pytest.approx(back, abs=0.01) for back, label in radii if label is not None)


def test_odd_labels_are_kept_or_their_loss_is_told(
    kind: LabelFormat, odd: LabelSet, context: ImportContext, tmp_path: Path
) -> None:
    written = kind.write(odd, target(kind, tmp_path), ExportOptions())
    imported = kind.read(target(kind, tmp_path), context)
    assert imported.rejections == ()
    assert [label.t_us for label in imported.labels] == [label.t_us for label in odd.labels]
    if kind.name in EXACT:
        assert imported.labels == odd.labels
        assert written.losses == ()
        return
    changed = [
        label.t_us for back, label in zip(imported.labels, odd.labels, strict=True) if back.state is not label.state
    ]
    lost = [loss for loss in written.losses if "state" in loss]
    assert bool(changed) == bool(lost), (changed, written.losses)
    assert (not changed) or kind.name not in KEEPS_STATES
    if kind.name == "voc":
        assert [without_provenance(back) for back in imported.labels] == [
            without_provenance(label) for label in odd.labels
        ]


def test_the_same_labels_give_the_same_bytes(kind: LabelFormat, odd: LabelSet, tmp_path: Path) -> None:
    if kind.name == "hdf5":  # HDF5 stores no times here, so even its bytes agree
        first, second = (tmp_path / name / "labels.h5" for name in "ab")
    else:
        first, second = tmp_path / "a" / "x", tmp_path / "b" / "x"
    kind.write(odd, first, ExportOptions())
    kind.write(odd, second, ExportOptions())
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert not any(PREFIX in name for name in contents(tmp_path / "a"))


def test_no_labels_at_all_are_a_legal_export(
    kind: LabelFormat, balls: LabelSet, context: ImportContext, tmp_path: Path
) -> None:
    empty = dataclasses.replace(balls, labels=())
    kind.write(empty, target(kind, tmp_path), ExportOptions())
    assert kind.read(target(kind, tmp_path), context).labels == ()


def test_nothing_to_read_is_a_rejection_that_names_the_place(
    kind: LabelFormat, context: ImportContext, tmp_path: Path
) -> None:
    imported = kind.read(tmp_path / "nowhere", context)
    assert imported.labels == ()
    assert len(imported.rejections) == 1
    assert str(imported.rejections[0]).startswith(f"{tmp_path / 'nowhere'}:1: ")


def test_a_read_only_place_is_a_clear_error(kind: LabelFormat, odd: LabelSet) -> None:
    from core.errors import LabelError

    with pytest.raises(LabelError, match="cannot write"):
        kind.write(odd, target(kind, Path("/proc/nowhere")), ExportOptions())


def test_damaged_files_never_crash_an_import_nor_lose_a_label_silently(kind: LabelFormat, tmp_path: Path) -> None:
    result = damage_and_read(kind, 50, np.random.default_rng(7), tmp_path / "damaged")
    assert (result.crashes, result.silent_drops, result.nameless) == (0, 0, 0), result.first_problem
    assert result.rejected > 5


def test_the_damage_trial_notices_crashes_and_silent_drops(tmp_path: Path) -> None:
    voc = FORMATS["voc"]

    def crash(path: Path, context: ImportContext):
        raise UnicodeDecodeError("utf-8", b"", 0, 1, "boom")

    def drop(path: Path, context: ImportContext):
        return dataclasses.replace(voc.read(path, context), labels=(), rejections=())

    crashing = damage_and_read(dataclasses.replace(voc, read=crash), 3, np.random.default_rng(0), tmp_path / "d")
    assert crashing.crashes == 3
    dropping = damage_and_read(dataclasses.replace(voc, read=drop), 3, np.random.default_rng(0), tmp_path / "d")
    assert dropping.silent_drops == 3


def test_two_labels_of_one_time_are_one_label_and_one_rejection(context: ImportContext, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t_us,state,x_px,y_px\n5,visible,1,2\n5,visible,3,4\n")
    imported = FORMATS["csv"].read(file, context)
    assert [label.x_px for label in imported.labels] == [1.0]
    assert [str(rejection) for rejection in imported.rejections] == [
        f"{file}:3: a second label at 5 us; the first one is kept"
    ]


@pytest.mark.gate
def test_unvisited_pictures_have_no_file_and_no_row(balls: LabelSet, tmp_path: Path) -> None:
    with_gaps = dataclasses.replace(balls, frames_us=tuple(range(0, 2_000_000, 2500)))
    for name, format_ in FORMATS.items():
        written = format_.write(with_gaps, target(format_, tmp_path / name), ExportOptions(drop_unchecked=True))
        imported = format_.read(target(format_, tmp_path / name), ImportContext(balls.sensor))
        assert len(imported.labels) == len(balls.labels), name
        assert written.files
    assert LabelState.NO_BALL in {label.state for label in balls.labels}


RADII = {
    "voc": rb' r="[^"]*"',
    "cvat": rb'(?<=name="r_px">)[^<]*',
    "coco": rb'(?<="r_px": )[^,}]*',
    "csv": rb"(?<=,)5\.5(?=,)",
}
"""Where a format says a radius of its own."""


@pytest.mark.parametrize("text", ["0", "-2.5", "nan", "0.0"])
@pytest.mark.parametrize("name", sorted(RADII))
def test_a_radius_of_0_is_refused_and_counted_wherever_a_format_can_say_one(
    name: str, text: str, context: ImportContext, tmp_path: Path
) -> None:
    ball = Label(t_us=1_000_000, state=LabelState.VISIBLE, x_px=100.0, y_px=90.0, r_px=5.5)
    labels = LabelSet("rec", "left", "anna", context.sensor, (ball,))
    (file,) = FORMATS[name].write(labels, target(FORMATS[name], tmp_path), ExportOptions()).files
    content, found = file.read_bytes(), RADII[name]
    said = f' r="{text}"' if name == "voc" else text
    changed, count = re.subn(found, said.encode(), content)
    assert count >= 1, "the radius is written somewhere"
    file.write_bytes(changed)
    imported = FORMATS[name].read(file, context)
    assert imported.labels == () and len(imported.rejections) == 1
    assert "\n" not in str(imported.rejections[0])


@pytest.mark.parametrize(
    ("name", "file", "text"),
    [
        ("tracknet", "a.csv", "Frame,Visibility,X,Y\n0,1,10,20\n"),
        ("coco", "a.json", '{"images": [{"id": 1, "file_name": "f_t000001000000us.png"}], "categories": [{"id": 1, '
         '"name": "ball"}], "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "keypoints": [10, 20, 2], '
         '"bbox": [10, 20, 0, 0]}]}'),
        ("cvat", "a.xml", '<annotations><image id="0" name="f_t000001000000us.png"><points label="ball" '
         'points="10,20"/></image></annotations>'),
        ("csv", "a.csv", "t_us,state,x_px,y_px\n1000000,visible,10,20\n"),
    ],
)  # fmt: skip
def test_a_point_without_a_size_becomes_a_ball_whose_radius_is_not_known(
    name: str, file: str, text: str, tmp_path: Path, context: ImportContext
) -> None:
    (tmp_path / file).write_text(text)
    context = dataclasses.replace(context, frame_times_us=np.array([1_000_000]))
    imported = FORMATS[name].read(tmp_path / file, context)
    assert imported.rejections == ()
    assert [(label.t_us, label.state, label.r_px) for label in imported.labels] == [
        (1_000_000, LabelState.VISIBLE, None)
    ]


def test_contacts_come_back_from_every_format_that_holds_them(
    kind: LabelFormat, balls: LabelSet, context: ImportContext, tmp_path: Path
) -> None:
    made = Provenance(source=PositionSource.CORRECTED, annotator="Åsa", made_at_us=3, detector="auto#1", tool="t")
    contacts = (
        ContactLabel(t_us=0, kind=ContactKind.HIT),
        ContactLabel(t_us=1_000_003, kind=ContactKind.BOUNCE, sigma_us=0.1, provenance=made),
        ContactLabel(t_us=1_200_000, kind=ContactKind.NET, sigma_us=250.0),
    )
    kind.write(dataclasses.replace(balls, contacts=contacts), target(kind, tmp_path), ExportOptions())
    imported = kind.read(target(kind, tmp_path), context)
    assert imported.rejections == () and len(imported.labels) == len(balls.labels)
    assert kind.contacts == (kind.name in (*EXACT, "coco", "sony", "openttgames"))
    if kind.name == "openttgames":  # which has no word for a hit, and holds nothing but kind and time
        assert [(one.t_us, one.kind) for one in imported.contacts] == [(one.t_us, one.kind) for one in contacts[1:]]
        return
    assert imported.contacts == (contacts if kind.contacts else ())
