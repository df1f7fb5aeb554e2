"""Trials of faults: a job in a process of its own, a fault at some moment, what is left, and the next start.

The processes are forked from one that has loaded everything already, so a trial takes as long as its work.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import stat
import sys
import threading
import time
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final, Literal

import numpy as np

from benchmarks.app.faults.injections import Injection, WatchedDisk, inject
from benchmarks.app.faults.jobs import JOBS, FaultJob, run_job
from benchmarks.app.soak.process_usage import children_of, usage_of
from core.errors import CommandError, RallyscopeError

FaultName = Literal[
    "killed", "disk full", "device error", "read-only folder", "stopped", "power cut", "clock stepped", "worker killed"
]
Phase = Literal["prepare", "work", "again"]
PRELOADED: Final = ["benchmarks.app.faults.trials", "app.cli.main", "app.cli.train", "app.cli.export", "app.cli.tune"]
LONGEST_S: Final = 120.0
"""A job that takes longer has hung."""

CLOCK_STEP_S: Final = 3600.0
GOES_ON: Final = ("stopped", "clock stepped")
"""Faults that must not end the work."""
SPAWNED: Final = b"spawn_main"
"""In the command line of every worker."""
WARM_S: Final = 15.0
"""A first time that takes longer has compiled something, and is no measure of the others."""
PROGRESS: Final = ("so far", " left")
"""The ends of a line that only says that it goes on."""


@dataclass(frozen=True, slots=True)
class EndedTrial:
    """How a process ended, and what it said."""

    code: int
    said: str
    errors: str
    seconds: float
    steps: int
    """Writes, syncs and renames of Python in the folder."""
    unsynced: tuple[str, ...]
    """Files whose content or name a power cut could still have taken at its end."""
    worker_killed: bool = False
    """By the trial; what it worked at may have gone on by itself."""


@dataclass(frozen=True, slots=True)
class FaultResult:
    """What came of one fault."""

    lost: int
    """Things that were acknowledged, or that have a final name, and are not there whole."""
    unclear: str
    """What was not one clear line, or a next start that did not work; empty if all was well."""
    struck: bool
    """Whether the fault came before the job had ended."""


class FaultTrials:
    """Trials of one job in a folder of its own."""

    def __init__(self, job: FaultJob, folder: Path) -> None:
        self._job, self._folder, self._inputs = job, folder, folder / "inputs"
        self._inputs.mkdir(parents=True)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)
        self._run("prepare", self._inputs)
        self.clean = self._run("work", self._fresh())
        if self.clean.code or not job.whole(self._inputs, self._out):
            raise RuntimeError(f"{job.name} does not work without a fault: {self.clean.errors[-2000:]}")
        if self.clean.seconds > WARM_S:  # something was compiled
            self.clean = self._run("work", self._fresh())
        sizes = [path.stat().st_size for path in self._out.rglob("*") if path.is_file()]
        self._largest_bytes = max(sizes, default=1)

    @property
    def _out(self) -> Path:
        return self._folder / "out"

    def _fresh(self) -> Path:
        shutil.rmtree(self._out, ignore_errors=True)
        self._out.mkdir()
        return self._out

    def try_fault(self, fault: FaultName, rng: np.random.Generator, *, pause_s: float = 1.0) -> FaultResult:
        """One trial, at a random moment."""
        out = self._fresh()
        injection = Injection(folder=out)
        moment_s = float(rng.uniform(0, self.clean.seconds))
        match fault:
            case "power cut":
                ended = self._run("work", out)
                return FaultResult(len(ended.unsynced), "", struck=True)
            case "killed":
                ended = self._run("work", out, injection, at_s=moment_s)
            case "worker killed":
                ended = self._run("work", out, injection, at_s=moment_s, worker=True)
            case "clock stepped":
                by_s = float(rng.choice([-CLOCK_STEP_S, CLOCK_STEP_S]))
                ended = self._run("work", out, replace(injection, clock_step_s=by_s, clock_after_s=moment_s))
            case "stopped":
                ended = self._run("work", out, injection, at_s=moment_s, pause_s=pause_s)
            case "disk full":
                limit = int(rng.uniform(0, self._largest_bytes))
                ended = self._run("work", out, replace(injection, largest_bytes=limit))
            case "device error":
                number = int(rng.integers(1, self.clean.steps + 1))
                ended = self._run("work", out, replace(injection, fails_from=number))
            case "read-only folder":
                out.chmod(stat.S_IRUSR | stat.S_IXUSR)
                ended = self._run("work", out, replace(injection, as_plain_user=True))
                out.chmod(stat.S_IRWXU)
        return self._judge(fault, ended)

    def _judge(self, fault: FaultName, ended: EndedTrial) -> FaultResult:
        out, job = self._out, self._job
        struck = ended.code != 0 or ended.worker_killed or fault in GOES_ON
        unclear = "" if fault == "killed" else unclear_ending(ended)
        if fault in GOES_ON and ended.code:
            unclear = f"it did not go on: {ended.errors[-300:]}"
        try:
            lost = job.lost(self._inputs, out, ended.said)
        except RallyscopeError as error:
            lost, unclear = 1, unclear or f"what is left: {error}"
        except Exception as error:  # noqa: BLE001 (the trial is there to find any of them)
            lost, unclear = 1, unclear or f"what is left: {type(error).__name__}: {error}"
        again = self._run("again", out)
        if again.code or not job.whole(self._inputs, out):
            unclear = unclear or f"the next start ends with {again.code}: {again.errors[-300:]}"
        return FaultResult(lost, unclear, struck)

    def _run(
        self,
        phase: Phase,
        out: Path,
        injection: Injection | None = None,
        *,
        at_s: float | None = None,
        pause_s: float | None = None,
        worker: bool = False,
    ) -> EndedTrial:
        """The job to its end; `at_s` after its beginning it, or a worker of it, is killed, or stopped for `pause_s`."""
        said, say = self._context.Pipe(duplex=False)
        errors, err = self._context.Pipe(duplex=False)
        facts, tell = self._context.Pipe(duplex=False)
        arguments = (self._job.name, phase, self._inputs, out, injection or Injection(folder=out), say, err, tell)
        process = self._context.Process(target=_work, args=arguments)
        process.start()
        for end in (say, err, tell):
            end.close()
        texts: dict[str, str] = {}
        readers = [
            threading.Thread(target=_read_all, args=(pipe, texts, name), daemon=True)
            for name, pipe in (("said", said), ("errors", errors))
        ]
        for reader in readers:
            reader.start()
        begun_s, worker_killed = _begun(facts), False
        if at_s is not None and process.pid is not None:
            process.join(at_s)
            if worker:
                worker_killed = _kill_worker(process)
            elif pause_s is None:
                process.kill()
            else:
                pause(process.pid, pause_s)
        process.join(LONGEST_S)
        seconds = time.monotonic() - begun_s
        if process.is_alive():
            process.kill()
            process.join()
            texts["errors"] = f"it hung for {LONGEST_S:.0f} s"
        for reader in readers:
            reader.join(5)
        told = _told(facts)
        code = process.exitcode if process.exitcode is not None else -1
        return EndedTrial(
            code, texts.get("said", ""), texts.get("errors", ""), seconds, told[0], told[1], worker_killed
        )


def unclear_ending(ended: EndedTrial) -> str:
    """What is wrong with an ending that has to be good, or one clear line and exit code 2; empty if nothing is."""
    lines = [line for line in ended.errors.splitlines() if line.strip() and not line.endswith(PROGRESS)]
    if ended.code == 0:
        return ""
    ours = [line for line in lines if line.startswith("rallyscope: ")]
    if ended.code != 2 or len(ours) != 1 or "Traceback" in ended.errors or len(lines) > 1:
        return f"exit code {ended.code}: {' | '.join(lines)[-600:]}"
    return "" if ";" in ours[0] or ", " in ours[0] else f"no remedy: {ours[0]}"


def _work(
    name: str, phase: Phase, inputs: Path, out: Path, injection: Injection, say: Connection, err: Connection,
    tell: Connection,
) -> None:  # fmt: skip
    """In the process of the job."""
    os.dup2(say.fileno(), 1)
    os.dup2(err.fileno(), 2)
    say.close()
    err.close()
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
    job = JOBS[name]
    if phase == "prepare":
        job.prepare(inputs)
        return
    disk = inject(injection)
    tell.send("begun")
    code, line = run_job(job.work if phase == "work" else job.again, inputs, out)
    sys.stderr.write(line)
    sys.stdout.flush()
    sys.stderr.flush()
    tell.send((disk.steps, _unsynced(out, disk)))
    os._exit(code)


def _unsynced(out: Path, disk: WatchedDisk) -> tuple[str, ...]:
    """What a person would miss: files with a final name, except for those that tell of a process or hold a lock."""
    missing = []
    for path in sorted(out.rglob("*")):
        if path.is_file() and not path.name.startswith(".") and path.name not in PASSING:
            if path.stat().st_ino not in disk.synced:
                missing.append(f"content of {path.relative_to(out)}")
            if os.path.realpath(path) not in disk.named:
                missing.append(f"name of {path.relative_to(out)}")
    return tuple(missing)


PASSING: Final = ("status.json", "control.json", "versions.json")
"""What a run says while it goes on; nobody misses it afterwards."""


def _read_all(pipe: Connection, texts: dict[str, str], name: str) -> None:
    parts = []
    while part := os.read(pipe.fileno(), 1 << 16):
        parts.append(part)
        texts[name] = b"".join(parts).decode("utf-8", "replace")


def pause(pid: int, seconds: float) -> None:
    """Stopped for so long; nothing if it has ended, whoever took note of its end (here its fork server does)."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(pid, signal.SIGCONT)


def _kill_worker(process: BaseProcess) -> bool:
    """As the kernel does when the memory is full: the largest, as soon as there is one; False if it ends before."""
    while process.is_alive() and process.pid is not None:
        try:
            workers = [pid for pid in children_of(process.pid) if SPAWNED in Path(f"/proc/{pid}/cmdline").read_bytes()]
            if workers:
                os.kill(max(workers, key=lambda pid: usage_of(pid).resident_mb), signal.SIGKILL)
                return True
        except (OSError, CommandError):  # it has just ended
            pass
        time.sleep(0.01)
    return False


def _begun(facts: Connection) -> float:
    try:
        if facts.poll(LONGEST_S):
            facts.recv()
    except EOFError:
        pass
    return time.monotonic()


def _told(facts: Connection) -> tuple[int, tuple[str, ...]]:
    try:
        return facts.recv() if facts.poll(0) else (0, ())
    except EOFError:
        return 0, ()
