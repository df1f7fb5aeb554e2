"""The one training of a workspace: starts its process, tells it what is wanted, and notices how it ends.

The process is the command line's `rallyscope train`, and everything is said through the run's files. So it outlives
the browser that started it, and the app too: an app that is started again finds it by those files, from which the state
of each run is judged.
"""

from __future__ import annotations

import itertools
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from app.shared.job_backends import HERE_ONLY, THIS_MACHINE, JobBackends
from app.shared.workspace import Workspace, free_path, slug_from
from core.errors import CommandError, RallyscopeError
from core.extras import require_package
from core.files import lock_descriptor
from core.learning.config import RunConfig
from core.learning.runs.run_files import (
    Control,
    RunCommand,
    RunStatus,
    create_run,
    is_held,
    read_control,
    read_run,
    read_status,
    write_control,
)

RunPhase = Literal["new", "starting", "running", "paused", "stopping", "ending", "stopped", "finished", "failed"]
ACTIVE: Final[tuple[RunPhase, ...]] = ("starting", "running", "paused", "stopping", "ending")
UNEXPECTED: Final = "the process ended unexpectedly"
LOG_NAME: Final = "train.log"
LOG_TAIL_BYTES: Final = 16_384
LOG_LINES: Final = 12
LOG_LINE_CHARACTERS: Final = 240


@dataclass(frozen=True, slots=True)
class RunState:
    """One run as the app sees it."""

    name: str
    config: RunConfig
    phase: RunPhase
    status: RunStatus | None
    episodes_per_s: float | None
    """Limit of its speed; None: unlimited."""
    changed_s: float
    """When its files were last written, seconds since the epoch."""
    message: str = ""
    """Error message, in one line."""

    @property
    def active(self) -> bool:
        """Whether a process trains it."""
        return self.phase in ACTIVE

    @property
    def resumable(self) -> bool:
        """Whether it ended, or never began, before it was complete."""
        return self.phase in ("new", "stopped", "failed")


@dataclass(frozen=True, slots=True)
class Ended:
    """A process of this app that has ended."""

    returncode: int
    log_tail: tuple[str, ...]


def judge_run(
    run: Path, config: RunConfig, *, child_lives: bool, child_pid: int | None, stopping: bool, ended: Ended | None
) -> RunState:
    """The state of a run: `child_*` and `ended` are of a process that this app started for it, if it did."""
    status = read_status(run)
    if status is not None and status.state in ("running", "paused") and not child_lives and not is_held(run):
        status = read_status(run)  # it may have ended between the two looks, and its last status came first
    message = ""
    phase: RunPhase
    if child_lives and (status is None or status.pid != child_pid):
        phase = "stopping" if stopping else "starting"
    elif status is not None and status.state in ("running", "paused") and (child_lives or is_held(run)):
        phase = "stopping" if stopping else status.state
    elif child_lives:
        phase = "ending"  # its last status is written
    elif ended is not None and ended.returncode != 0:
        phase, message = "failed", _why(status, ended)
    elif status is None:
        phase = "new"
    elif status.state in ("running", "paused", "failed"):
        phase = "failed"
        message = status.message or UNEXPECTED
    else:
        phase = status.state
    return RunState(run.name, config, phase, status, read_control(run).episodes_per_s, _changed_s(run), message)


def _why(status: RunStatus | None, ended: Ended) -> str:
    if ended.returncode < 0:
        try:
            name = signal.Signals(-ended.returncode).name
        except ValueError:
            name = f"signal {-ended.returncode}"
        return f"the process was killed ({name})"
    for line in reversed(ended.log_tail):
        if line.startswith("rallyscope: ") and "this is a bug" not in line:
            return line.removeprefix("rallyscope: ")
    failure = status.message if status is not None and status.state == "failed" else ""
    return f"{failure or UNEXPECTED} (exit code {ended.returncode})"


def _changed_s(run: Path) -> float:
    for name in ("status.json", "config.toml"):
        try:
            return (run / name).stat().st_mtime
        except OSError:
            continue
    return 0.0


def read_log_tail(run: Path) -> tuple[str, ...]:
    """The last lines of a run's log; none if there is none."""
    try:
        with (run / LOG_NAME).open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - LOG_TAIL_BYTES))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return ()
    lines = [line.rstrip()[:LOG_LINE_CHARACTERS] for line in text.replace("\r", "\n").splitlines()]
    return tuple(line for line in lines if line)[-LOG_LINES:]


logger = logging.getLogger(__name__)
COMMAND = (sys.executable, "-P", "-m", "app.cli", "train", "--resume")
"""Command line; backend flags and the run's folder follow. Of a browser's input it contains only a slug."""
TURN_NAME = ".training.lock"
"""File in the folder of runs, locked while a server on that folder trains."""
SEEDS_HERE = 1
"""Seeds trained at a time: the app needs the other cores."""


@dataclass(slots=True)
class _Child:
    """A process that this app started."""

    name: str
    process: subprocess.Popen[bytes]
    turn: ExitStack
    """Holds the folder's turn to train until it is closed."""


class Trainer:
    """Shared by all browsers; every method may be called from any thread."""

    def __init__(self, workspace: Workspace, places: JobBackends = HERE_ONLY) -> None:
        self._workspace, self._places = workspace, places
        self._place_of: dict[str, str] = {}
        """Backend of each run that this app started; a resumed run uses the same."""
        self._lock = threading.RLock()
        self._child: _Child | None = None
        self._stopping: str | None = None
        self._ended: dict[str, Ended] = {}
        self._configs: dict[str, tuple[float, RunConfig]] = {}

    def runs(self) -> tuple[RunState, ...]:
        """All runs of the workspace, last changed first."""
        with self._lock:
            self._reap()
            found = [state for name in self._workspace.run_names() if (state := self._state(name)) is not None]
            for state in found:
                self._insist(state)
        return tuple(sorted(found, key=lambda state: state.changed_s, reverse=True))

    def active(self) -> RunState | None:
        """The run in training."""
        return next((state for state in self.runs() if state.active), None)

    @contextmanager
    def free_name(self, stem: str) -> Iterator[str]:
        """Unused run name: the stem with a number; the run is to be made within the `with` block."""
        stem = slug_from(stem)[:50]
        with free_path(self._workspace.run_path(f"{stem}-{number}") for number in itertools.count(1)) as run:
            yield run.name

    def start(self, name: str, config: RunConfig, episodes_per_s: float | None, place: str = THIS_MACHINE) -> str:
        """Start a new run; returns its name.

        Raises:
            RallyscopeError: if another one is being trained, the name is taken or unusable, or there is no such place.
        """
        require_package("torch", "training")
        self._places.flags(place, SEEDS_HERE)
        with self._lock:
            self._check_free()
            run = self._workspace.run_path(name)
            if run.exists():
                raise CommandError("there is a run of this name already", got=run.name, remedy="take another name")
            with self._turn() as turn:
                create_run(run, config)
                write_control(run, Control("run", episodes_per_s))
                self._place_of[run.name] = place
                self._launch(run, turn)
            return run.name

    def resume(self, name: str) -> None:
        """Resume a stopped or crashed run from its last checkpoint.

        Raises:
            RallyscopeError: if there is no such run, it is finished, or another one is being trained.
        """
        require_package("torch", "training")
        with self._lock:
            self._check_free()
            state = self._known(name)
            if not state.resumable:
                raise CommandError(f"the run is {state.phase}", got=name, remedy="start another")
            run = self._workspace.run_path(name)
            with self._turn() as turn:
                write_control(run, replace(read_control(run), command="run"))
                self._launch(run, turn)

    def ask(self, command: RunCommand) -> None:
        """Pause, stop, or continue the run in training; nothing if there is none."""
        with self._lock:
            state = self.active()
            if state is None:
                return
            if command == "stop":
                self._stopping = state.name
            run = self._workspace.run_path(state.name)
            write_control(run, replace(read_control(run), command=command))

    def set_pace(self, episodes_per_s: float | None) -> None:
        """Limit the speed of the run in training, or remove the limit; nothing if there is none."""
        with self._lock:
            state = self.active()
            if state is not None:
                run = self._workspace.run_path(state.name)
                write_control(run, replace(read_control(run), episodes_per_s=episodes_per_s))

    def _check_free(self) -> None:
        state = self.active()
        if state is not None:
            raise CommandError("one training at a time", got=f"{state.name} is {state.phase}", remedy="stop it first")

    @contextmanager
    def _turn(self) -> Iterator[ExitStack]:
        """Hold the folder's turn to train; what takes it over from the stack holds it longer.

        Two servers may share a folder, and a run of the other one is seen only once its process has begun.

        Raises:
            CommandError: if a server holds it.
        """
        descriptor = os.open(self._workspace.runs / TURN_NAME, os.O_RDWR | os.O_CREAT, 0o666)
        with ExitStack() as turn:
            turn.callback(os.close, descriptor)
            try:
                lock_descriptor(descriptor)
            except BlockingIOError as error:
                got = "another server trains on this folder"
                raise CommandError(
                    "one training at a time", got=got, remedy="stop it there first, or wait for it"
                ) from error
            yield turn

    def _known(self, name: str) -> RunState:
        state = self._state(name) if name in self._workspace.run_names() else None
        if state is None:
            raise CommandError("no such run", got=repr(name[:80]), remedy="choose one from the list")
        return state

    def _launch(self, run: Path, turn: ExitStack) -> None:
        self._ended.pop(run.name, None)
        self._stopping = None
        flags = self._places.flags(self._place_of.get(run.name, THIS_MACHINE), SEEDS_HERE)
        _append_log(run, "started")
        try:
            with (run / LOG_NAME).open("ab") as log:
                process = subprocess.Popen(
                    [*COMMAND, *flags, "--out", str(run.absolute())],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # Ctrl-C in the app's terminal must not reach it
                    creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
                    env={**os.environ, "PYTHONUNBUFFERED": "1"},
                )
        except OSError as error:
            raise CommandError("cannot start the training", got=error.strerror, where=run.name) from error
        self._child = child = _Child(run.name, process, turn.pop_all())

        def end_turn() -> None:
            process.wait()
            with self._lock:
                child.turn.close()  # also where nobody looks at the runs: another server may wait for it

        threading.Thread(target=end_turn, name="rallyscope-training-ends", daemon=True).start()

    def _reap(self) -> None:
        child = self._child
        if child is None or (code := child.process.poll()) is None:
            return
        self._child = None
        child.turn.close()
        if self._stopping == child.name:
            self._stopping = None
        run = self._workspace.run_path(child.name)
        self._ended[child.name] = Ended(code, read_log_tail(run))
        if code != 0:
            _append_log(run, f"ended with code {code}")
            logger.warning("training %s ended with code %d; see %s", child.name, code, run / LOG_NAME)

    def _state(self, name: str) -> RunState | None:
        run = self._workspace.run_path(name)
        config = self._config(run)
        if config is None:
            return None
        child = self._child if self._child is not None and self._child.name == name else None
        state = judge_run(
            run,
            config,
            child_lives=child is not None,
            child_pid=None if child is None else child.process.pid,
            stopping=self._stopping == name,
            ended=self._ended.get(name),
        )
        if self._stopping == name and not state.active:
            self._stopping = None
        return state

    def _insist(self, state: RunState) -> None:
        """Repeat a command: a process that is just starting ignores earlier ones."""
        if state.phase == "stopping":
            run = self._workspace.run_path(state.name)
            if read_control(run).command != "stop":
                write_control(run, replace(read_control(run), command="stop"))

    def _config(self, run: Path) -> RunConfig | None:
        """Config of a run; None for a run of another version, or one that is just being created."""
        try:
            changed_s = (run / "config.toml").stat().st_mtime
            known = self._configs.get(run.name)
            if known is None or known[0] != changed_s:
                known = self._configs[run.name] = (changed_s, read_run(run))
        except (OSError, RallyscopeError):
            return None
        return known[1]


def _append_log(run: Path, text: str) -> None:
    try:
        with (run / LOG_NAME).open("ab") as log:
            log.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}\n".encode())
    except OSError:
        logger.exception("cannot write the log of %s", run)
