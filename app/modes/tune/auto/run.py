"""One search: `rallyscope tune` as a child process, which leaves the page its processor."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from app.background.child import ChildProcess, share_in
from app.modes.tune.auto.report import TuningReport, read_report
from app.modes.tune.label_score import find_reference
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.detection.saved import load_detector, save_detector
from core.errors import CommandError, RallyscopeError

LOOK_S: Final = 0.1
Against = Literal["truth", "labels"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AutoTuneRequest:
    """What a browser asked for, with all that it takes to do it."""

    title: str
    """What is tuned on, for a person."""
    recording: Path
    uuid: str
    camera: str
    all_cameras: bool
    method: Method
    against: Against
    labels: Path
    """The folder of the label stores."""
    parameters: tuple[str, ...]
    trials: int
    seed: int
    start: DetectorConfig
    where: tuple[str, ...]
    """The flags of `tune` that say where the trials are made."""


@dataclass(frozen=True, slots=True)
class AutoTuneAnswer:
    """What came of it."""

    config: DetectorConfig
    report: TuningReport


class AutoTuneCancelledError(Exception):
    """Nobody wants the answer any more."""


def run_auto_tune(
    request: AutoTuneRequest,
    *,
    progress: Callable[[float], None],
    say: Callable[[str], None],
    cancelled: Callable[[], bool],
) -> AutoTuneAnswer:
    """Search, and wait for what is found; `say` hears in words how it goes.

    Raises:
        RallyscopeError: with what the verb said if it refuses or fails.
        AutoTuneCancelledError: when `cancelled()` becomes true; the process is over then.
    """
    with tempfile.TemporaryDirectory(prefix="rallyscope-tune-") as folder:
        start, found = Path(folder) / "start.toml", Path(folder) / "found.toml"
        save_detector(request.method, request.start, start)
        answer = ""
        ended = threading.Event()

        def hear(line: str) -> None:
            nonlocal answer
            if line.startswith("{"):
                answer = line
            elif (share := share_in(line)) is not None:
                progress(share)
                say(line)

        child = ChildProcess(*_command(request, start, found), on_line=hear, on_end=ended.set)
        while not ended.wait(LOOK_S):
            if cancelled():
                child.stop()
                raise AutoTuneCancelledError
        code = child.wait()
        if code == 2:
            raise RallyscopeError(child.last_words.removeprefix("rallyscope: "))
        if code != 0:
            remedy = "run `rallyscope tune` to see why"
            raise RallyscopeError("the search ended without an answer", got=child.last_words, remedy=remedy)
        return AutoTuneAnswer(load_detector(found).config, read_report(answer))


def _command(request: AutoTuneRequest, start: Path, found: Path) -> list[str]:
    """What follows `python -m`."""
    words = ["app.cli", "tune", str(request.recording), "--method", request.method, "--config", str(start)]
    words += ["--parameters", ",".join(request.parameters), "--out", str(found), "--json", "--until-eof"]
    words += ["--trials", str(request.trials), "--seed", str(request.seed), *request.where]
    if not request.all_cameras:
        words += ["--camera", request.camera]
    words += ["--against", request.against]
    if request.against == "labels":
        reference = find_reference(request.labels, request.uuid, request.camera)
        if reference is None:
            raise CommandError("nobody has labelled this camera", got=request.camera, remedy="label it in Label first")
        words += ["--data", str(request.labels.parent), "--annotator", reference.layer.annotator]
    return words
