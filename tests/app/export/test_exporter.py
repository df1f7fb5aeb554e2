import os
import threading

import numpy as np
import pytest

from app.export.exporter import Exporter, ExportState
from app.export.frozen import freeze, write_frozen
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError, check_cancelled, unfinished_file
from app.shared.workspace import Workspace
from core.errors import CommandError
from core.files import claimed
from core.recordings import open_recording
from tests.waiting import PATIENCE_S, eventually


def write(path, progress, cancelled):
    with unfinished_file(path, overwrite=False) as unfinished:
        unfinished.write_bytes(b"x" * 2_000_000)
    return (path,)


def test_names_are_made_by_the_server_and_never_taken_twice(tmp_path) -> None:
    exporter = Exporter(Workspace(tmp_path))
    assert exporter.state() is None and exporter.files() == ()
    for number in (1, 2):
        assert exporter.start("../Rally One", ".rrd", write) == f"rally-one-{number}.rrd"
        eventually(lambda: not exporter._job.running, "the export to end")
    assert {(file.name, file.size) for file in exporter.files()} == {
        ("rally-one-1.rrd", 2_000_000), ("rally-one-2.rrd", 2_000_000)
    }  # fmt: skip
    state = exporter.state()
    assert not state.failed and state.message == "rally-one-2.rrd: 2.0 MB"
    assert exporter.path_of("rally-one-1.rrd") == tmp_path / "exports" / "rally-one-1.rrd"
    for name in ("../../etc/passwd", "rally-one-3.rrd", ""):
        with pytest.raises(CommandError, match="no such export"):
            exporter.path_of(name)


def test_a_name_that_something_else_writes_to_is_left_to_it(tmp_path) -> None:
    exporter = Exporter(Workspace(tmp_path))
    with claimed([tmp_path / "exports" / "a-1.rrd"]):
        assert exporter.start("a", ".rrd", write) == "a-2.rrd"
        eventually(lambda: not exporter._job.running, "the export to end")
    assert [file.name for file in exporter.files()] == ["a-2.rrd"]


def test_an_export_that_cannot_begin_keeps_neither_the_folder_nor_the_name(tmp_path, monkeypatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", no_thread)
        with pytest.raises(RuntimeError):
            Exporter(Workspace(tmp_path)).start("a", ".rrd", write)
    exporter = Exporter(Workspace(tmp_path))
    assert exporter.start("a", ".rrd", write) == "a-1.rrd"
    eventually(lambda: not exporter._job.running, "the export to end")


def no_thread(thread):
    raise RuntimeError("can't start new thread")


def test_what_is_removed_while_it_is_listed_is_left_out(tmp_path, monkeypatch) -> None:
    exporter, root = Exporter(Workspace(tmp_path)), tmp_path / "exports"
    for name in ("kept.rrd", "bag/kept.mcap", "removed/metadata.yaml"):
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_bytes(b"x")
    (root / "gone.rrd").symlink_to(root / "nowhere")  # listed, and not there any more

    def without_removed(read):
        def read_folder(folder):
            if str(folder).endswith("removed"):
                raise FileNotFoundError(folder)
            return read(folder)

        return read_folder

    monkeypatch.setattr(os, "listdir", without_removed(os.listdir))
    monkeypatch.setattr(os, "scandir", without_removed(os.scandir))
    assert {file.name for file in exporter.files()} == {"kept.rrd", "bag/kept.mcap"}


def test_the_note_is_there_as_soon_as_a_result_is(tmp_path) -> None:
    seen: list[str] = []

    class Watched(Exporter):
        """Notes each message that another thread could read."""

        def __setattr__(self, name: str, value: object) -> None:
            super().__setattr__(name, value)
            if name == "_message" and value:
                seen.append(str(value))

    exporter = Watched(Workspace(tmp_path))
    exporter.start("a", ".rrd", write, lambda: "From 0 s on")
    eventually(lambda: not exporter.state().running, "the export to end")
    assert seen == ["a-1.rrd: 2.0 MB. From 0 s on"]


def test_one_export_at_a_time_and_a_cancelled_one_leaves_nothing(tmp_path) -> None:
    exporter, go = Exporter(Workspace(tmp_path)), threading.Event()

    def slow(path, progress, cancelled):
        with unfinished_file(path, overwrite=False) as unfinished:
            unfinished.write_bytes(b"half")
            progress(0.5)
            assert go.wait(PATIENCE_S)
            check_cancelled(cancelled)
        return (path,)

    exporter.start("a", ".rrd", slow)
    eventually(lambda: exporter.state().share == 0.5, "half of the export")
    of_another_server = Exporter(Workspace(tmp_path))
    with pytest.raises(CommandError, match=r"another server on this folder exports; .*wait for it"):
        of_another_server.start("a", ".rrd", write)
    assert exporter.files() == (), "what is unfinished is not in the list"
    with pytest.raises(CommandError, match="another export runs"):
        exporter.start("b", ".rrd", write)
    exporter.cancel()
    go.set()
    assert exporter.state().message == "cancelled"
    eventually(lambda: not list((tmp_path / "exports").iterdir()), "what is unfinished to be gone")

    def begin() -> bool:
        try:
            return of_another_server.start("a", ".rrd", write) == "a-1.rrd"
        except CommandError:  # the thread of the first one has not ended yet
            return False

    eventually(begin, "the other server to be free to export")
    eventually(lambda: not of_another_server.state().running, "the export to end")


def test_a_file_that_another_program_made_meanwhile_is_not_replaced(tmp_path) -> None:
    def export() -> None:
        with unfinished_file(tmp_path / "a.rrd", overwrite=False) as unfinished:
            unfinished.write_bytes(b"ours")
            (tmp_path / "a.rrd").write_bytes(b"theirs")

    with pytest.raises(CommandError, match=r"a\.rrd: exists already"):
        export()
    assert (tmp_path / "a.rrd").read_bytes() == b"theirs" and [path.name for path in tmp_path.iterdir()] == ["a.rrd"]


def test_what_went_wrong_is_said(tmp_path) -> None:
    exporter = Exporter(Workspace(tmp_path))

    def fail(path, progress, cancelled):
        raise CommandError("the disk is full")

    exporter.start("a", "", fail)
    eventually(lambda: exporter.state().message, "a message")
    assert exporter.state().failed and "the disk is full" in exporter.state().message


def test_the_time_left_follows_from_the_pace() -> None:
    assert ExportState("a", True, 0.25, 10.0, "", False).left_s == pytest.approx(30)
    assert ExportState("a", True, 0.0, 10.0, "", False).left_s is None


def test_a_frozen_recording_is_the_part_that_it_was_taken_from(serve_recording) -> None:
    span = Span(100_000, 300_000)
    with open_recording(serve_recording) as recording:
        frozen, left = freeze(recording, span), recording.cameras["left"]
        held = frozen.cameras["left"]
        assert frozen.uuid == recording.uuid and frozen.duration_us == span.end_us and frozen.ball is recording.ball
        assert held.event_count == len(left.slice(100_000, 300_000)) > 0
        assert np.array_equal(held.slice(0, 150_000).t_us, left.slice(100_000, 150_000).t_us)
        assert held.calibration is left.calibration and held.sensor == left.sensor
        assert np.array_equal(held.counts_per_ms(), left.counts_per_ms())


def test_a_frozen_recording_that_is_written_has_its_events_and_truth_from_time_0_on(serve_recording, tmp_path) -> None:
    span, path, told = Span(100_000, 300_000), tmp_path / "frozen.h5", []
    with open_recording(serve_recording) as recording:
        uuid = write_frozen(freeze(recording, span), span, path, progress=told.append, cancelled=lambda: False)
        with open_recording(path) as written:
            assert (written.uuid, written.duration_us) == (uuid, 200_000) and uuid != recording.uuid
            for name, camera in recording.cameras.items():
                there, here = camera.slice(100_000, 300_000), written.cameras[name].slice(0, 200_000)
                assert np.array_equal(here.t_us, there.t_us - 100_000) and np.array_equal(here.x_px, there.x_px)
                assert np.array_equal(here.on, there.on)
                assert np.array_equal(written.cameras[name].calibration.K, camera.calibration.K)
                before, after = camera.truth.at([250_000]), written.cameras[name].truth.at([150_000])
                assert after.u_px == pytest.approx(before.u_px)
            assert written.ball.t_us[0] >= 0 and written.ball.t_us[-1] < 200_000
    assert told == sorted(told) and told[-1] == 1.0
    assert [file.name for file in tmp_path.iterdir()] == ["frozen.h5"]


def test_a_frozen_recording_that_is_cancelled_leaves_nothing(serve_recording, tmp_path) -> None:
    span = Span(0, 300_000)
    with open_recording(serve_recording) as recording:
        frozen = freeze(recording, span)
    with pytest.raises(ExportCancelledError):
        write_frozen(frozen, span, tmp_path / "f.h5", progress=lambda share: None, cancelled=lambda: True)
    assert list(tmp_path.iterdir()) == []
