"""Opening a file in one browser: the list, what the file holds and does not say, the import with progress."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from app.background.jobs import Job, Progress
from app.formatting import fact_rows, notice_of, size_text
from app.modes.services import Services
from app.shared.files import OfferedFile, OpeningChoices, bring_in, look_at
from app.shared.samples import PAGE, missing_samples
from app.web.pages import Json, Message
from core.errors import CommandError, RallyscopeError, RecordingError
from core.events import SensorSize
from core.files import end_unfinished
from core.foreign_tables import UNITS_US
from core.recordings import Recording, knows_ball
from core.recordings.import_facts import IMPORTED_FROM, ImportFacts
from core.recordings.sources.kinds import kind_of
from core.recordings.sources.source import ImportOptions, parse_polarity
from core.text import counted

logger = logging.getLogger(__name__)


MAX_LISTED: Final = 1_000
MAX_NOTES: Final = 8
LONGEST_NOTE: Final = 400
FIELDS: Final[Mapping[str, str]] = {
    "--width": "Width",
    "--height": "Height",
    "--time-unit": "Time unit",
    "--polarity": "Polarity",
}
"""Option of the import on the command line -> what its field in the dialog is called."""
_FIELD_NAMES: Final = tuple(option.removeprefix("--").replace("-", "_") for option in FIELDS)
"""By which the page sends what is in the fields."""


def list_message(files: Sequence[OfferedFile], missing: Sequence[str] = ()) -> Message:
    """Message with the dialog's list: names and keys, no paths; and the public samples that could be added."""
    rows: list[Json] = [
        [file.key, file.path.name, file.folder, file.kind, size_text(file.size_bytes)] for file in files[:MAX_LISTED]
    ]
    hint = ""
    if missing:
        names = ", ".join(missing)
        hint = f"More samples ({names}): put their files into the folder samples of the workspace; see {PAGE}."
    return {"files": rows, "left_out": max(0, len(files) - MAX_LISTED), "samples": hint}


def facts_message(name: str, source: str, kind: str | None, recording: Recording) -> Message:
    """Message with the facts about the opened file."""
    cameras: list[Json] = [
        f"{camera}: {stream.sensor}, {counted(stream.event_count, 'event')}"
        for camera, stream in recording.cameras.items()
    ]
    notes = _shortened(recording.notes)
    facts: list[Json] = [*cameras, f"{recording.duration_us / 1e6:.3f} s", *_extras(recording)]
    return {"state": "done", "file": source, "name": name, "kind": kind or "", "facts": facts, "notes": notes}


def question_message(facts: ImportFacts) -> Message:
    """What a person sees before a file is imported: the facts of each camera, what is assumed, and the notes."""
    cameras: list[Json] = []
    for camera in facts.cameras:
        found = fact_rows(camera, complete=facts.complete)
        rows: list[Json] = [[label, value[:LONGEST_NOTE]] for label, value in found]
        cameras.append({"name": camera.name, "rows": rows})
    assumed = _shortened([in_field_words(note) for note in facts.assumed])
    notes = _shortened([in_field_words(note) for note in facts.notes if note not in facts.assumed])
    return {"state": "question", "cameras": cameras, "assumed": assumed, "notes": notes, "complete": facts.complete}


def _shortened(notes: Sequence[str]) -> list[Json]:
    """As many notes as have room, without the one that only names the file."""
    texts = [note[:LONGEST_NOTE] for note in notes if not note.startswith(IMPORTED_FROM)]
    return [*texts[:MAX_NOTES], *([f"... and {len(texts) - MAX_NOTES} more"] if texts[MAX_NOTES:] else [])]


def in_field_words(text: str) -> str:
    """A message of the import with the names of the dialog's fields in place of the options."""
    text = re.sub(r"(such as|or) --[a-z-]+ ", r"\1 ", text)
    return re.sub("|".join(FIELDS), lambda option: FIELDS[option[0]], text)


def choices_from(fields: Mapping[str, str]) -> OpeningChoices:
    """What a person wrote into the fields of the dialog (`width`, `height`, `time_unit`, `polarity`; empty: unsaid).

    Raises:
        CommandError: naming the field that cannot be used.
    """
    sides = {}
    for name in ("width", "height"):
        text = fields.get(name, "")
        # `int` takes digits of all scripts, and texts of any length.
        if text and not (text.isascii() and text.isdecimal() and len(text) < 8):
            raise CommandError("not a number of pixels", expected="such as 640", got=text, where=name.capitalize())
        sides[name] = int(text) if text else None
    width_px, height_px = sides.values()
    if (width_px is None) != (height_px is None):
        raise CommandError("Width and Height go together", remedy="fill in both, or neither")
    time_unit, polarity = fields.get("time_unit") or None, fields.get("polarity", "")
    if time_unit is not None and time_unit not in UNITS_US:
        raise CommandError("no such unit", expected=", ".join(UNITS_US), got=time_unit, where="Time unit")
    try:
        sensor = None if width_px is None or height_px is None else SensorSize(width_px, height_px)
    except RallyscopeError as error:
        raise CommandError(str(error), where="Width and Height") from error
    try:
        return OpeningChoices(sensor, ImportOptions(time_unit, parse_polarity(polarity) if polarity else None))
    except RallyscopeError as error:
        raise CommandError(str(error), where="Polarity") from error


def refusal_message(source: str, path: Path, error: RallyscopeError) -> Message | None:
    """Question after a file was refused for what the fields of the dialog can state; None if they cannot help."""
    if not any(option in str(error) for option in FIELDS):
        return None
    problem = in_field_words(str(problem_message(source, path, error)["problem"]))
    nothing: list[Json] = []
    return {
        "state": "question",
        "cameras": nothing,
        "assumed": nothing,
        "notes": nothing,
        "complete": True,
        "problem": f"{source}: {problem}",
    }


def problem_message(source: str, path: Path, error: RallyscopeError) -> Message:
    """One line on why a file could not be opened, with the name that the user knows."""
    title, details = notice_of(error)
    details = details.replace(str(path), source).removeprefix(source).lstrip("; ")
    return {"state": "failed", "file": source, "problem": ": ".join(part for part in (title, details) if part)}


def _extras(recording: Recording) -> list[Json]:
    known: list[Json] = []
    if any(stream.calibration is not None for stream in recording.cameras.values()):
        known.append("calibrated")
    if knows_ball(recording):
        known.append("knows the true ball")
    return known


BUSY: Final = "A file is being opened already; wait for it, or cancel it."
ASKED: Final = "{asked} waits for your answer: import or cancel it first. {name} was not opened."
"""Said of a further file, while a question is open."""
GONE = "That file is no longer in the list."


class FilePage(Protocol):
    """The page's interface for files."""

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None: ...
    def send(self, kind: str, values: Message) -> None: ...
    def receive(self, take: Callable[[Path], None]) -> None: ...


class FileSession(Protocol):
    """The session's interface for files."""

    def later(self, act: Callable[[], None]) -> None: ...
    def open_recording(self, name: str) -> None: ...


@dataclass(frozen=True, slots=True)
class _Source:
    path: Path
    name: str
    """File name shown to the user."""
    received: bool = False
    """Whether it was uploaded; it is then in a temporary folder of its own."""

    def release(self) -> None:
        if self.received:
            end_unfinished(self.path.parent)


@dataclass(frozen=True, slots=True)
class _Question:
    """A file that was looked at, and is not to be imported before the person says so."""

    source: _Source
    fields: Mapping[str, str]
    """As they were when it was looked at."""
    refused: bool
    """Whether it cannot be imported as it was looked at."""


class FileOpening:
    """Owned by the session; every method but the page's callbacks is called by its loop."""

    def __init__(self, page: FilePage, services: Services, pool: Executor, session: FileSession) -> None:
        self._page = page
        self._services = services
        self._pool = pool
        self._session = session
        self._job: Job[Message | None] | None = None
        self._question: _Question | None = None
        self._last_sent: Message = {}
        self._called = ""
        self._number = 0
        self._dialogs = 0
        self._sent_share = -1.0
        self._lock = threading.Lock()
        self._closed = False
        self._arrived: set[_Source] = set()
        """Uploaded file whose import has not begun yet."""
        page.listen("files", self._asked)
        page.receive(self._received)

    def show_dialog(self) -> None:
        """Show the page's dialog."""
        self._dialogs += 1
        self._page.send("files_dialog", {"number": self._dialogs})

    def open_listed(self, name: str) -> bool:
        """Import an event file by its name in the list of recordings; False if it is none of them."""
        path = self._services.library.file_to_import(name)
        if path is None:
            return False
        self._begin(_Source(path, path.name))
        return True

    def show_recording(self, name: str) -> None:
        """Let the page take away the facts of a file once a recording of another name is shown."""
        if self._last_sent.get("state") == "done" and self._last_sent["name"] != name:
            self._tell({"state": "left"})

    def tick(self) -> None:
        """Send the import's progress."""
        if self._job is not None and self._job.share > self._sent_share + 0.005:
            self._sent_share = self._job.share
            self._tell({"state": "importing", "share": round(self._sent_share, 3)})

    def close(self) -> None:
        """The browser has disconnected; its import is cancelled."""
        with self._lock:
            self._closed = True
            arrived, self._arrived = self._arrived, set[_Source]()
        for source in arrived:
            source.release()
        self._cancel()

    # Messages from the page; nothing in them is trusted.

    def _asked(self, message: Message) -> None:
        match message.get("do"):
            case "list":
                self._pool.submit(self._list)
            case "open":
                key = str(message.get("key"))[:64]
                self._pool.submit(self._find, key)
            case "import":
                number = message.get("number")
                self._session.later(lambda: self._confirmed(number))
            case "check":
                number, given = message.get("number"), message.get("fields")
                given = given if isinstance(given, dict) else {}
                fields = {name: str(given.get(name, ""))[:200].strip() for name in _FIELD_NAMES}
                self._session.later(lambda: self._checked(number, fields))
            case "cancel":
                self._cancel()

    def _list(self) -> None:
        try:
            files = self._services.files.all()
            self._page.send("files", list_message(files, missing_samples({file.path.name for file in files})))
        except RallyscopeError as error:
            logger.warning("the files cannot be listed: %s", error)

    def _find(self, key: str) -> None:
        file = self._services.files.find(key)
        self._session.later(lambda: self._open_offered(file))

    def _open_offered(self, file: OfferedFile | None) -> None:
        if file is None:
            self._tell_anew("", {"state": "failed", "problem": GONE})
        else:
            self._begin(_Source(file.path, file.path.name))

    def _received(self, path: Path) -> None:
        """In the server's event loop."""
        source = _Source(path, path.name, received=True)
        with self._lock:
            closed = self._closed
            if not closed:
                self._arrived.add(source)
        if closed:
            source.release()
        else:
            self._session.later(lambda: self._begin(source))

    # The import ----------------------------------------------------------------------------------------------------

    def _begin(self, source: _Source) -> None:
        with self._lock:
            self._arrived.discard(source)
            closed = self._closed
        question = self._question
        if closed or self._job is not None or question is not None:
            source.release()
            if not closed:
                asks = "" if question is None else ASKED.format(asked=question.source.name, name=source.name)
                self._tell({**self._last_sent, "problem": asks or BUSY})
            return
        self._tell_anew(source.name, {"state": "importing", "share": 0.0})
        self._look(source, {})

    def _look(self, source: _Source, fields: Mapping[str, str]) -> None:
        """Look at a file, and ask unless it says everything itself."""
        services, choices = self._services, choices_from(fields)

        def look(progress: Progress, cancelled: Callable[[], bool]) -> Message | None:
            facts = look_at(source.path, services.library, services.workspace, choices=choices, cancelled=cancelled)
            if facts is None or not (facts.needs_a_look or fields):
                return None if cancelled() else self._bring_in(source, choices, progress, cancelled)
            return question_message(facts)

        self._start(source, fields, look)

    def _checked(self, number: Json, fields: Mapping[str, str]) -> None:
        """The person has filled in fields of the question of this number."""
        try:
            choices_from(fields)
        except CommandError as error:
            if number == self._number:
                self._tell({**self._last_sent, "problem": str(error)})
            return
        question = self._answered(number)
        if question is not None:
            self._tell_anew(question.source.name, {"state": "importing", "share": 0.0})
            self._look(question.source, fields)

    def _confirmed(self, number: Json) -> None:
        """The person wants the file of the question of this number."""
        question = self._answered(number, refused=False)
        if question is None:
            return
        source, choices = question.source, choices_from(question.fields)
        self._tell({"state": "importing", "share": 0.0})
        self._start(source, question.fields, lambda *watch: self._bring_in(source, choices, *watch))

    def _answered(self, number: Json, *, refused: bool = True) -> _Question | None:
        """Take the question of this number, which may be of a file that was `refused`."""
        with self._lock:
            question = self._question
            if question is None or number != self._number or (question.refused and not refused):
                return None
            self._question = None
        return question

    def _bring_in(
        self, source: _Source, choices: OpeningChoices, progress: Progress, cancelled: Callable[[], bool]
    ) -> Message | None:
        """In the thread of a job: the file as a recording, and what was recognised; None if it was cancelled."""
        services, kind = self._services, kind_of(source.path)
        name = bring_in(
            source.path,
            services.library,
            services.workspace,
            choices=choices,
            received=source.received,
            progress=progress,
            cancelled=cancelled,
        )
        if name is None:
            return None
        recording = services.library.open(name)
        if not recording.cameras:
            raise RecordingError("no cameras in this recording", where=source.path, remedy="choose another")
        return facts_message(name, source.name, kind, recording)

    def _start(
        self,
        source: _Source,
        fields: Mapping[str, str],
        act: Callable[[Progress, Callable[[], bool]], Message | None],
    ) -> None:
        """Begin a job; if its answer is a question the source is kept for it, else released."""
        number = self._number

        def work(progress: Progress, cancelled: Callable[[], bool]) -> Message | None:
            kept, refused = False, False
            try:
                try:
                    answer = act(progress, cancelled)
                except RallyscopeError as error:
                    answer, refused = refusal_message(source.name, source.path, error), True
                    if answer is None:
                        raise
                if answer is None or answer["state"] != "question":
                    return answer
                with self._lock:
                    # Under the lock: a page that is closed meanwhile would leave the source to nobody.
                    kept = not cancelled() and not self._closed
                    self._question = _Question(source, fields, refused) if kept else None
                return {**answer, "fields": dict(fields), "refused": refused}
            finally:
                if not kept:
                    source.release()

        self._sent_share = 0.0
        self._job = Job(
            work,
            lambda facts: self._session.later(lambda: self._done(number, facts)),
            lambda error: self._session.later(lambda: self._failed(number, source, error)),
        )

    def _done(self, number: int, facts: Message | None) -> None:
        if number != self._number or self._job is None:
            return
        self._job = None
        if facts is None:
            return
        self._tell(facts)
        if facts["state"] == "done":
            self._session.open_recording(str(facts["name"]))

    def _failed(self, number: int, source: _Source, error: Exception) -> None:
        if number != self._number or self._job is None:
            return
        self._job = None
        if isinstance(error, RallyscopeError):
            self._tell(problem_message(source.name, source.path, error))
        else:
            logger.error("unexpected error while a file was opened", exc_info=error)
            self._tell({"state": "failed", "problem": "This is a bug; the terminal shows where."})

    def _cancel(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            job.cancel()
        with self._lock:  # after that no job makes a question any more
            question, self._question = self._question, None
        if question is not None:
            question.source.release()
        if job is not None or question is not None:
            self._tell({"state": "cancelled"})

    def _tell_anew(self, name: str, values: Message) -> None:
        self._number += 1
        self._called = name
        self._tell(values)

    def _tell(self, values: Message) -> None:
        self._last_sent = {name: value for name, value in values.items() if name != "problem"}
        self._page.send("opening", {"number": self._number, "file": self._called, **values})
