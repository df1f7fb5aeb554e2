"""Labels as one ZIP file of another tool's format."""

import dataclasses
import zipfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import viser

from app.export.unfinished import ExportCancelledError
from app.modes.label.label_files import LabelFilesRequest, write_label_files, zip_label_files
from app.modes.label.results import LabelResultsPanel
from app.modes.label.sources import sources_of
from core.errors import LabelError
from core.recordings import open_recording
from labels.formats import FORMATS, ExportOptions, ImportContext
from labels.model import ContactKind, ContactLabel, Label, LabelState


@pytest.fixture
def ask(serve_recording: Path):
    with open_recording(serve_recording) as recording:
        source = sources_of(recording)["left"]
        labels = tuple(
            Label(t_us=t_us, state=LabelState.VISIBLE, x_px=100.0 + t_us / 1e4, y_px=200.0, r_px=9.0)
            for t_us in range(200_000, 220_000, 5_000)
        )

        def make(name: str, *, labels: tuple[Label, ...] = labels, pictures: bool = False) -> LabelFilesRequest:
            return LabelFilesRequest(
                format=name, recording_uuid=recording.uuid, annotator="anna", source=source, labels=labels,
                pictures=pictures, options=ExportOptions(drop_unchecked=True),
            )  # fmt: skip

        yield make


@pytest.mark.parametrize("name", [name for name, kind in FORMATS.items() if kind.label])
def test_what_is_in_the_zip_is_what_the_command_line_writes_and_comes_back(
    ask: Callable[..., LabelFilesRequest], tmp_path: Path, name: str
) -> None:
    shares: list[float] = []
    made = zip_label_files(ask(name), tmp_path / "anna.zip", shares.append, lambda: False)
    assert made.labels == 4 and shares == sorted(shares) and shares[-1] == 1.0
    assert [path.name for path in tmp_path.iterdir()] == ["anna.zip"]
    zipfile.ZipFile(tmp_path / "anna.zip").extractall(tmp_path / "out")
    written = write_label_files(ask(name), tmp_path / "plain")
    root = tmp_path / "out" / "anna"
    same = {file.relative_to(root): file.read_bytes() for file in root.rglob("*") if file.is_file()}
    plain = {file.relative_to(tmp_path / "plain"): file.read_bytes() for file in written.files}
    assert set(plain) <= set(same)
    sensor = ask(name).source.sensor
    back = FORMATS[name].read(root, ImportContext(sensor, None, name, "left"))
    assert [label.t_us for label in back.labels] == [200_000, 205_000, 210_000, 215_000]
    assert all(abs((label.x_px or 0) - 100.0 - label.t_us / 1e4) < 0.71 for label in back.labels)


def test_pictures_come_along(ask: Callable[..., LabelFilesRequest], tmp_path: Path) -> None:
    made = zip_label_files(ask("yolo", pictures=True), tmp_path / "a.zip", lambda share: None, lambda: False)
    assert len(made.pictures) == 4
    archive = zipfile.ZipFile(tmp_path / "a.zip")
    pictures = [name for name in archive.namelist() if name.endswith(".png")]
    image = cv2.imdecode(np.frombuffer(archive.read(pictures[0]), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert len(pictures) == 4 and image is not None and image.shape == (720, 1280)


def test_nothing_is_left_of_an_export_without_labels_or_one_that_is_cancelled(
    ask: Callable[..., LabelFilesRequest], tmp_path: Path
) -> None:
    with pytest.raises(LabelError, match="no labels to export"):
        zip_label_files(ask("voc", labels=()), tmp_path / "a.zip", lambda share: None, lambda: False)
    with pytest.raises(ExportCancelledError):
        zip_label_files(ask("voc"), tmp_path / "a.zip", lambda share: None, lambda: True)
    assert list(tmp_path.iterdir()) == []


def test_what_is_downloaded_without_a_choice_loses_nothing(
    ask: Callable[..., LabelFilesRequest], tmp_path: Path
) -> None:
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    try:
        chosen = LabelResultsPanel(server.gui, *[lambda: None] * 3).format
    finally:
        server.stop()
    label = Label(t_us=5, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0, r_px=3.0, covariance_px2=(1.0, 0.0, 1.0))
    contacts = (ContactLabel(t_us=6, kind=ContactKind.BOUNCE, sigma_us=100.0),)
    whole = dataclasses.replace(ask(chosen, labels=(label,)), contacts=contacts)
    made = write_label_files(whole, tmp_path)
    assert made.losses == () and (made.labels, made.contacts) == (1, 1)
