"""Opening a file without a browser: the messages that the page would get."""

import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.client_session.file_opening import FileOpening
from app.modes.services import Services
from app.shared.files import incoming_folder
from app.shared.library import Library
from app.shared.samples import SIMULATED
from app.shared.workspace import Workspace
from app.web.pages import Message
from core.files import PREFIX
from tests.app.shared.event_files import write_csv, write_npz
from tests.waiting import eventually


class Page:
    """What the opening says to its page, and the loop that it runs in."""

    def __init__(self) -> None:
        self.told: dict[str, list[Message]] = {}
        self.opened: list[str] = []
        self.acts: list[Callable[[], None]] = []

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None:
        self.ask = lambda **values: listener(values)

    def receive(self, take: Callable[[Path], None]) -> None:
        self.take = take

    def send(self, kind: str, values: Message) -> None:
        self.told.setdefault(kind, []).append(values)

    def later(self, act: Callable[[], None]) -> None:
        self.acts.append(act)

    def open_recording(self, name: str) -> None:
        self.opened.append(name)

    @property
    def state(self) -> Message:
        return self.told.get("opening", [{}])[-1]

    def run_until(self, condition: Callable[[], object]) -> None:
        def turn() -> object:
            if found := condition():
                return found
            while self.acts:
                self.acts.pop(0)()
            return None

        eventually(turn, "what the page is to be told", lambda: self.told)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "clips"
    folder.mkdir()
    return folder


@pytest.fixture
def services(tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Services]:
    monkeypatch.setattr("app.shared.files.LONGEST_LOOK_S", 1e6)  # a slow machine looks at the whole file, too
    workspace = Workspace(tmp_path / "data")
    services = Services.of(workspace, Library(workspace, (folder,)))
    yield services
    services.close()


@pytest.fixture
def page() -> Page:
    return Page()


@pytest.fixture
def opening(services: Services, page: Page) -> Iterator[FileOpening]:
    with ThreadPoolExecutor(1) as pool:
        opening = FileOpening(page, services, pool, page)
        yield opening
        opening.close()


def listed(page: Page) -> list:
    """The rows of the dialog, but for the samples that come with the app."""
    page.told.pop("files", None)
    page.ask(do="list")
    page.run_until(lambda: "files" in page.told)
    return [row for row in page.told["files"][-1]["files"] if row[2] != SIMULATED]  # type: ignore[index]


def received(services: Services, name: str) -> Path:
    return incoming_folder(services.workspace) / name


def accept(page: Page) -> None:
    """Wait for the question, and have the file imported."""
    page.run_until(lambda: page.state.get("state") in ("question", "failed"))
    assert page.state["state"] == "question", page.state
    page.ask(do="import", number=page.state["number"])


def first_problem(page: Page) -> Message:
    """The first message with a problem; more may have been sent since."""
    page.run_until(lambda: any("problem" in one for one in page.told.get("opening", [])))
    return next(one for one in page.told["opening"] if "problem" in one)


def left_in(services: Services) -> list[str]:
    return sorted(path.name for path in services.workspace.recordings.iterdir())


def test_a_file_of_the_list_is_imported_described_and_opened(opening, page, services, folder) -> None:
    write_npz(folder / "clip.npz")
    ((key, name, where, kind, size),) = listed(page)
    assert (name, where, kind) == ("clip.npz", "clips", "NumPy") and size.endswith("kB")
    page.ask(do="open", key=key)
    accept(page)
    page.run_until(lambda: page.opened)
    assert page.opened == ["clip"] and page.state["state"] == "done" and page.state["kind"] == "NumPy"
    assert "128x128, 500 events" in str(page.state["facts"]) and "0.499 s" in str(page.state["facts"])
    assert str(folder) not in str(page.told), "no path of the server is told"


def test_what_was_said_of_a_file_is_taken_away_once_another_recording_is_shown(opening, page, folder) -> None:
    write_npz(folder / "clip.npz")
    page.ask(do="open", key=listed(page)[0][0])
    accept(page)
    page.run_until(lambda: page.opened)
    opening.show_recording("clip")
    assert page.state["state"] == "done"
    opening.show_recording("demo")
    assert page.state["state"] == "left"
    told = len(page.told["opening"])
    opening.show_recording("clip")
    assert len(page.told["opening"]) == told


def test_what_a_damaged_file_lost_is_said(opening, page, services) -> None:
    path = received(services, "cut.raw")
    header = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% end\n"
    words = [0x8000, 0x6001, 0x0010] + [0x2010 + k for k in range(100)]
    path.write_bytes(header + b"".join(word.to_bytes(2, "little") for word in words) + b"\x01")
    page.take(path)
    accept(page)
    asked = page.state
    page.run_until(lambda: page.state.get("state") in ("done", "failed"))
    assert page.state["state"] == "done" and page.state["notes"] == asked["notes"] != [], page.state
    assert page.opened == ["cut"] and left_in(services) == ["cut.h5"]


def test_a_bad_file_is_one_line_with_its_own_name_and_leaves_nothing(opening, page, services) -> None:
    path = received(services, "evil.raw")
    path.write_bytes(b"\x00\xff no events at all")
    page.take(path)
    page.run_until(lambda: page.state.get("state") == "failed")
    said = str(page.state["problem"])
    assert "format is not recognised" in said and "\n" not in said and PREFIX not in said
    assert page.state["file"] == "evil.raw" and not left_in(services) and not page.opened


@pytest.mark.parametrize("key", ["", "../../etc/passwd", None, 7, ["x"], "0" * 32, "x" * 10_000])
def test_a_key_that_nobody_gave_opens_nothing(opening, page, key) -> None:
    page.ask(do="open", key=key)
    page.run_until(lambda: page.state.get("state") == "failed")
    assert "no longer in the list" in str(page.state["problem"]) and not page.opened


def test_a_second_file_waits_and_a_cancelled_one_leaves_nothing(opening, page, services) -> None:
    first, second = received(services, "first.csv"), received(services, "second.csv")
    write_csv(first, 200_000)
    write_csv(second)
    page.take(first)
    page.take(second)
    refused = first_problem(page)
    assert "already" in str(refused["problem"]) and refused["file"] == "first.csv"
    page.ask(do="cancel")
    assert page.state["state"] == "cancelled"
    page.run_until(lambda: not left_in(services))
    assert not page.opened
    page.take(write_csv(received(services, "third.csv")))
    accept(page)
    page.run_until(lambda: page.opened)
    assert page.opened == ["third"]


def test_a_browser_that_leaves_takes_what_it_sent_with_it(opening, page, services) -> None:
    page.take(write_csv(received(services, "sent.csv")))  # and nobody has begun with it
    opening.close()
    assert not left_in(services)
    page.take(write_csv(received(services, "late.csv")))
    assert not left_in(services)


def test_a_recording_of_a_folder_is_opened_where_it_lies(opening, page, services, folder, serve_recording) -> None:
    shutil.copy(serve_recording, folder / "court.h5")
    ((key, *_),) = listed(page)
    page.ask(do="open", key=key)
    page.run_until(lambda: page.opened)
    assert page.opened == ["court"] and not left_in(services)
    assert "calibrated" in page.state["facts"] and "knows the true ball" in page.state["facts"]


def test_an_event_file_chosen_by_its_name_in_the_list_of_recordings_is_imported_the_same_way(
    opening, page, services
) -> None:
    write_csv(services.workspace.recordings / "mine.csv")
    assert not opening.open_listed("no-such")
    assert opening.open_listed("mine.csv (CSV, imported when opened)")
    accept(page)
    page.run_until(lambda: page.opened)
    assert page.opened == ["mine"] and left_in(services) == ["mine.csv", "mine.h5"]


def test_what_is_assumed_is_shown_and_nothing_is_written_before_the_person_agrees(opening, page, services) -> None:
    page.take(write_csv(received(services, "mine.csv")))
    page.run_until(lambda: page.state.get("state") == "question")
    (camera,) = page.state["cameras"]
    rows = dict(camera["rows"])
    assert rows["sensor"] == "128x128, assumed" and rows["time unit"] == "microseconds, assumed"
    assert rows["events"] == "500: 250 ON, 250 OFF" and rows["left out"] == "nothing"
    assert ["sensor size" in line for line in page.state["assumed"]] == [True, False]
    assert page.state["file"] == "mine.csv" and page.state["complete"] is True and page.state["notes"] == []
    for number in (None, "1", page.state["number"] + 1, -1):
        page.ask(do="import", number=number)
    page.run_until(lambda: not page.acts)
    assert page.state["state"] == "question" and not [name for name in left_in(services) if name.endswith(".h5")]
    page.take(write_csv(received(services, "other.csv")))
    refused = first_problem(page)
    problem = str(refused["problem"])
    assert "waits for your answer" in problem and problem.endswith("other.csv was not opened."), problem
    assert refused["state"] == page.state["state"] == "question"
    number = page.state["number"]
    page.ask(do="cancel")
    page.run_until(lambda: not left_in(services))
    page.ask(do="import", number=number)
    page.run_until(lambda: not page.acts)
    assert page.state["state"] == "cancelled" and not page.opened and not left_in(services)


def test_what_the_file_does_not_say_can_be_filled_in_and_errors_name_the_field(opening, page, services) -> None:
    rows = "\n".join(f"{1000 * k + 500},{k % 30},{k % 20},{1 + k % 2}" for k in range(100))
    path = received(services, "odd.csv")
    path.write_text(f"t,x,y,p\n{rows}\n")
    page.take(path)
    page.run_until(lambda: page.state.get("state") == "question")
    assert page.state["refused"] and page.state["fields"] == {} and page.state["cameras"] == []
    problem = str(page.state["problem"])
    assert "odd.csv: Which polarity is ON cannot be told" in problem and "give Polarity, such as 1=on,2=off" in problem

    def check(**fields: str) -> Message:
        page.ask(do="check", number=page.state["number"], fields=fields)
        told = len(page.told["opening"])
        page.run_until(lambda: len(page.told["opening"]) > told and page.state["state"] == "question")
        return page.state

    page.ask(do="import", number=page.state["number"])  # refused: there is nothing to import
    for fields, wanted in (
        ({"width": "640"}, "Width and Height go together"),
        ({"width": "640", "height": "-1"}, "Height: not a number of pixels"),
        ({"width": "0", "height": "480"}, "Width and Height: impossible sensor size"),
        ({"time_unit": "h"}, "Time unit: no such unit"),
        ({"polarity": "1=up"}, "Polarity: not the meaning of polarities; expected such as 1=on,2=off"),
        ({"polarity": "1=on,2=off", "width": "8", "height": "8"}, "lie outside the 8x8 sensor"),
    ):
        assert wanted in str(check(**fields)["problem"]), fields
    asked = check(polarity="1=on,2=off", width="640", height="480", time_unit="ns")
    rows = dict(asked["cameras"][0]["rows"])
    assert rows["sensor"] == "640x480, as given" and rows["polarity"] == "1 = ON, 2 = OFF, as given"
    assert rows["time unit"] == "nanoseconds, as given" and not asked["refused"] and "problem" not in asked
    assert asked["fields"]["width"] == "640" and not [name for name in left_in(services) if name.endswith(".h5")]
    page.ask(do="import", number=asked["number"])
    page.run_until(lambda: page.opened)
    assert "camera: 640x480, 100 events" in page.state["facts"] and left_in(services) == ["odd.h5"]


def test_a_file_that_says_everything_is_imported_without_a_question(opening, page, services) -> None:
    records = np.zeros(100, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    records["t"], records["p"] = np.arange(100) * 1000, np.arange(100) % 2
    path = received(services, "plain.hdf5")
    with h5py.File(path, "w") as file:
        file["CD/events"] = records
        file.attrs["geometry"] = "640x480"
    page.take(path)
    page.run_until(lambda: page.opened)
    assert page.opened == ["plain"] and "question" not in [one["state"] for one in page.told["opening"]]


def test_what_was_imported_before_is_opened_without_a_question(opening, page, services) -> None:
    page.take(write_csv(received(services, "mine.csv")))
    accept(page)
    page.run_until(lambda: page.opened)
    page.told.clear()
    page.take(write_csv(received(services, "mine.csv")))
    page.run_until(lambda: len(page.opened) == 2)
    assert "question" not in [one["state"] for one in page.told["opening"]]


def test_a_browser_that_leaves_with_a_question_takes_its_file_with_it(opening, page, services) -> None:
    page.take(write_csv(received(services, "mine.csv")))
    page.run_until(lambda: page.state.get("state") == "question")
    assert left_in(services)
    opening.close()
    assert not left_in(services)


def test_of_a_large_file_the_first_part_is_shown_and_said_to_be_that(opening, page, services, monkeypatch) -> None:
    monkeypatch.setattr("app.shared.files.LONGEST_LOOK_S", 0.0)
    page.take(write_csv(received(services, "large.csv"), 300_000))
    page.run_until(lambda: page.state.get("state") == "question")
    rows = dict(page.state["cameras"][0]["rows"])
    assert page.state["complete"] is False and "in the part that was looked at" in rows["events"]
    assert rows["left out"] == "known after the import"
    accept(page)
    page.run_until(lambda: page.opened)
    assert "128x128, 300,000 events" in str(page.state["facts"])
