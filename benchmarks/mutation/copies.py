"""A copy of the tree, and Python run in it: in a process of its own, or in a fork that has the libraries already."""

from __future__ import annotations

import compileall
import math
import multiprocessing
import os
import py_compile
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any, Final

import psutil
from coverage import Coverage

STILL_S: Final = 120.0
MOVES_S: Final = 0.05
"""A run that has used no more processor time than the second for as long as the first, on the clock, waits for ever."""
WAITING: Final = 30.0
"""A run may take so many times its limit on the clock: on a busy machine it gets a small share."""
NOT_COPIED: Final = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "rallyscope-data")
NOT_COMPILED: Final = re.compile("/(tests|docs|benchmarks)/")
HERE: Final = Path(__file__).resolve().parent


def fork_server(libraries: Sequence[str]) -> ForkServerContext:
    """A server whose forks have imported these libraries, none of which is changed; numba's compiler is off in them."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(libraries))
    return context


class Copy:
    """A copy of the tree in a temporary folder, with the shared data beside it."""

    def __init__(self, root: Path, folder: Path, forks: ForkServerContext) -> None:
        self.root, self._said, self._forks = folder / "tree", folder / "said", forks
        shutil.copytree(root, self.root, ignore=NOT_COPIED)
        if (root.parent / "shared").is_dir():
            (folder / "shared").symlink_to(root.parent / "shared")
        # Bytecode that is checked against its source's content: what is not changed is compiled once, and no mutant is
        # taken for the original because it is as long and as old.
        mode = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(self.root, rx=NOT_COMPILED, quiet=1, invalidation_mode=mode)
        paths = [str(self.root), str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._environment = {"PYTHONPATH": os.pathsep.join(paths)}

    def run_compiled(self, arguments: list[str], limit_s: float) -> tuple[int, str]:
        """Run pytest here; the exit status, below 0 after the limit of processor or clock time, and what was said."""
        numba = {"NUMBA_CACHE_DIR": str(self.root.parent / "numba"), "NUMBA_DISABLE_JIT": "0"}
        with self._said.open("wb") as said:
            process = subprocess.Popen(
                [sys.executable, "-m", "pytest", *arguments], cwd=self.root, stdout=said, stderr=subprocess.STDOUT,
                env={**os.environ, **self._environment, **numba}, start_new_session=True,
                preexec_fn=lambda: _limit(limit_s),
            )  # fmt: skip

        def join(seconds: float) -> None:
            with suppress(subprocess.TimeoutExpired):
                process.wait(seconds)

        return self._finish(process.pid, join, lambda: process.poll(), limit_s)

    def run(
        self, arguments: list[str], limit_s: float, coverage: Mapping[str, Any] | None = None, **env: str
    ) -> tuple[int, str]:
        """Run pytest in a fork, kernels as Python; `coverage`: arguments of the `Coverage` that measures it."""
        self._said.unlink(missing_ok=True)
        environment = {**self._environment, **env}
        process = self._forks.Process(
            target=_pytest, args=(self.root, self._said, environment, arguments, limit_s, coverage)
        )
        process.start()
        assert process.pid is not None
        return self._finish(process.pid, process.join, lambda: process.exitcode, limit_s)

    def _finish(
        self, pid: int, join: Callable[[float], None], status: Callable[[], int | None], limit_s: float
    ) -> tuple[int, str]:
        """Wait for the end of a run; end what stands still, or has waited beyond all measure."""
        began_s = moved_s = time.monotonic()
        used_s = 0.0
        try:
            while status() is None:
                join(1.0)
                now_s, busy_s = time.monotonic(), _processor_s(pid)
                if busy_s > used_s + MOVES_S:
                    used_s, moved_s = busy_s, now_s
                if now_s - moved_s > STILL_S or now_s - began_s > WAITING * limit_s:
                    return -signal.SIGKILL, "time limit"
        finally:
            if status() is None:
                os.killpg(pid, signal.SIGKILL)
                join(60.0)
        text = self._said.read_text(encoding="utf-8", errors="replace") if self._said.exists() else ""
        return status() or 0, text


def _processor_s(pid: int) -> float:
    """Processor time of a process and its children, those that have ended among them, s."""
    total_s = 0.0
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        for one in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                total_s += sum(one.cpu_times()[:4])
    return total_s


def _limit(limit_s: float) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), math.ceil(limit_s)))


def _pytest(
    root: Path,
    said: Path,
    environment: Mapping[str, str],
    arguments: list[str],
    limit_s: float,
    coverage: Mapping[str, Any] | None,
) -> None:
    """In the fork: become a pytest that was started in the copy. Processor time counts from the fork."""
    os.setsid()
    _limit(limit_s)
    os.chdir(root)
    os.environ.update(environment)
    ours = ("", str(HERE.parents[1]))
    sys.path[:] = [*environment["PYTHONPATH"].split(os.pathsep), *(path for path in sys.path if path not in ours)]
    for name in [name for name in sys.modules if name.partition(".")[0] == "benchmarks"]:
        del sys.modules[name]  # the instrument's own tree, not the copy's
    output = os.open(said, os.O_WRONLY | os.O_CREAT)
    os.dup2(output, 1)
    os.dup2(output, 2)
    import pytest

    with nullcontext() if coverage is None else Coverage(**coverage).collect():
        status = int(pytest.main(arguments))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
