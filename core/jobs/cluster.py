"""The workers of a Dask cluster as a `concurrent.futures` executor. Nothing else of ours knows Dask."""

from __future__ import annotations

import functools
import hashlib
import logging
import platform
import time
import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, TypeVar

import dask.config
from distributed import Client, KilledWorker, Security, WorkerPlugin, get_worker

from core.errors import JobsError
from core.jobs.control import TasksStoppedError, use_one_thread
from core.registry import load_same_plugins, plugin_hashes

PACKAGES: Final = ("numpy", "numba", "distributed")
ROOT: Final = Path(__file__).parents[2]
OURS: Final = ("app", "core", "labels")

Versions = Mapping[str, str]


@functools.cache
def versions_here() -> dict[str, str]:
    """Package versions of this process; rallyscope's includes a hash of its source, so an edited copy differs."""
    found = {"python": platform.python_version(), "rallyscope": f"{_version('rallyscope')}+{_source_hash()}"}
    return found | {name: _version(name) for name in PACKAGES}


def check_versions(expected: Versions, got: Versions, where: str) -> None:
    """Raise JobsError, in one line with all differences, if a worker has other versions."""
    wrong = [name for name, value in expected.items() if got.get(name) != value]
    if wrong:
        raise JobsError(
            "a worker has other versions than this process",
            expected=", ".join(f"{name} {expected[name]}" for name in wrong),
            got=", ".join(f"{name} {got.get(name, 'none')}" for name in wrong),
            where=where,
            remedy="install the same on all machines of the cluster",
        )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def _source_hash() -> str:
    digest = hashlib.blake2b(digest_size=4)
    for path in sorted(path for part in OURS for path in (ROOT / part).rglob("*.py")):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


CONNECT_S: Final = 30.0
"""Timeout of the connection to a scheduler, s: one behind a tunnel, or on a busy machine, may need some seconds."""
CLOSE_S: Final = 10.0
"""Timeout of the end of a connection, s."""
ANSWER_S: Final = 60.0
"""Timeout of a scheduler's reply, s; it may be busy."""
LOOK_EVERY_S: Final = 2.0
"""Interval at which its workers are checked, s."""
NO_WORKER_S: Final = 60.0
"""Longest time without any worker, s: the first may be starting, or the last restarting."""
TELL_EVERY_S: Final = 0.5
"""Shortest time between two progress reports of a task, s."""
CERTIFICATES: Final = {
    "tls_ca_file": "DASK_DISTRIBUTED__COMM__TLS__CA_FILE",
    "tls_client_cert": "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT",
    "tls_client_key": "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY",
}
GONE: Final = "run it again when the scheduler is back; what is done stays"

R = TypeVar("R")


class ClusterExecutor(Executor):
    """Connection to a scheduler: checks the versions of its workers, and detects its loss.

    Raises:
        JobsError: if there is no such scheduler, certificates are missing, or workers have other versions.
    """

    blames_one: Final = False  # the scheduler blames all tasks queued at a worker that died

    def __init__(self, address: str) -> None:
        self._address = address
        self._topic = f"rallyscope-{uuid.uuid4().hex}"
        self._shares: dict[int, float] = {}
        self._submitted = 0
        self._looked_s = self._had_workers_s = time.monotonic()
        self._client: Any = _connect(address)
        try:
            self._check_workers()
            if plugins := plugin_hashes():
                self._client.register_plugin(_LoadPlugins(plugins), name=self._topic)
            self._client.subscribe_topic(self._topic, self._hear)
            self._executor = self._client.get_executor(pure=False)
        except BaseException:
            self._client.close(timeout=CLOSE_S)
            raise

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call `fn(*args, control)` on a worker, where `control` is a `TaskControl`."""
        number, self._submitted = self._submitted, self._submitted + 1
        task = _Task(fn, number, self._topic, versions_here())
        future = self._executor.submit(task, *args, **kwargs)
        future.add_done_callback(lambda ended: self._shares.pop(number, None))
        return future

    def shares(self) -> float:
        """Sum of the progress, 0 to 1 each, of the running tasks."""
        return sum(list(self._shares.values()))

    def is_lost(self, error: BaseException) -> bool:
        """Whether a task failed because its workers died more often than the scheduler allows."""
        return isinstance(error, KilledWorker | MemoryError)

    def check(self) -> None:
        """Raise JobsError if the scheduler is gone, or there was no worker for NO_WORKER_S."""
        if self._client.status not in ("running", "connecting"):
            raise JobsError("the cluster's scheduler is gone", where=self._address, remedy=GONE)
        now = time.monotonic()
        if now - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = now
        if self._workers():
            self._had_workers_s = now
        elif now - self._had_workers_s > NO_WORKER_S:
            remedy = f"start some: `dask worker {self._address} --nthreads 1 --nworkers auto`"
            raise JobsError("the cluster has no workers", where=self._address, remedy=remedy)

    def check_file(self, path: Path) -> None:
        """Raise JobsError if a worker does not see a file, or sees a different one of that name."""
        size = path.stat().st_size
        sizes: dict[str, int | None] = self._client.run(_size, str(path))
        if blind := [worker for worker, found in sizes.items() if found != size]:
            remedy = "use a folder that all machines of the cluster share, under the same path"
            raise JobsError("a worker does not see this file", where=path, got=blind[0], remedy=remedy)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect. With `cancel_futures` all our tasks are cancelled."""
        with suppress(Exception):  # the scheduler may be gone already
            if self._client.status == "running":
                if plugin_hashes():
                    self._client.unregister_worker_plugin(self._topic)
                self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close(timeout=CLOSE_S)

    def _workers(self) -> dict[str, int]:
        """Number of threads of each worker, by its address."""
        try:
            return self._client.sync(self._client.scheduler.ncores, callback_timeout=ANSWER_S)
        except (OSError, TimeoutError) as error:
            raise JobsError("the cluster's scheduler is gone", where=self._address, remedy=GONE) from error

    def _check_workers(self) -> None:
        """Check the versions of the present workers; each worker checks again before it starts a task."""
        if not self._workers():
            return
        found = self._client.run(_worker_facts, on_error="return")
        for worker, facts in found.items():
            if isinstance(facts, ImportError):
                remedy = "install the same version on all machines of the cluster"
                raise JobsError("a worker has no rallyscope", where=worker, got=facts, remedy=remedy)
            if isinstance(facts, BaseException):
                raise facts
            check_worker(versions_here(), facts[0], facts[1], worker)

    def _hear(self, event: tuple[float, Any]) -> None:
        number, share = event[1]
        self._shares[number] = share


class _Task:
    """A task's function as sent to a worker."""

    def __init__(self, fn: Callable[..., Any], number: int, topic: str, versions: Versions) -> None:
        self._fn, self._number, self._topic, self._versions = fn, number, topic, versions

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        worker = get_worker()
        check_worker(self._versions, *_worker_facts(worker), worker.address)
        use_one_thread()
        return self._fn(*args, _WorkerControl(worker, self._number, self._topic), **kwargs)


class _LoadPlugins(WorkerPlugin):
    """Lets every worker, also one that comes later, load our plugins before it unpacks what they made."""

    def __init__(self, plugins: dict[str, str]) -> None:
        self._plugins = plugins

    def setup(self, worker: Any) -> None:
        """Called once in each worker."""
        load_same_plugins(self._plugins)


class _WorkerControl:
    """Control of a task on a worker. Dask keeps threads running after a cancel, so the task has to poll."""

    def __init__(self, worker: Any, number: int, topic: str) -> None:
        self._worker, self._number, self._topic = worker, number, topic
        self._key = worker.get_current_task()
        self._reported_s = 0.0

    def __call__(self, share: float) -> None:
        now = time.monotonic()
        if now - self._reported_s < TELL_EVERY_S:
            return
        self._reported_s = now
        if self.stopped():
            raise TasksStoppedError
        self._worker.log_event(self._topic, (self._number, share))

    def stopped(self) -> bool:
        task = self._worker.state.tasks.get(self._key)
        return task is None or task.state not in ("executing", "long-running")


def _connect(address: str) -> Client:
    _be_quiet()
    security = _certificates() if address.startswith("tls:") else None
    try:
        return Client(address, security=security, timeout=CONNECT_S, set_as_default=False, name="rallyscope")
    except (OSError, TimeoutError, ValueError) as error:
        trusted = f", and its certificate of the authority in {CERTIFICATES['tls_ca_file']}" if security else ""
        remedy = f"is `dask scheduler` running there, and this its address{trusted}?"
        raise JobsError("no scheduler of a cluster answers", where=address, remedy=remedy) from error


def _certificates() -> Security:
    security = Security(require_encryption=True)
    for name, variable in CERTIFICATES.items():
        path = getattr(security, name)
        if path is None or not Path(path).is_file():
            remedy = f"set {', '.join(CERTIFICATES.values())}"
            raise JobsError("certificates are missing", expected=f"a file in {variable}", got=path, remedy=remedy)
    return security


def _be_quiet() -> None:
    """Silence Dask's log messages about the connection; our errors report it."""
    for name in ["distributed", *logging.root.manager.loggerDict]:
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)
    dask.config.set({"distributed.comm.timeouts.connect": f"{CONNECT_S:g}s"})


def _worker_facts(dask_worker: Any) -> tuple[dict[str, str], int]:
    """Versions of the worker that runs this, and its number of parallel tasks."""
    return versions_here(), dask_worker.state.nthreads


def check_worker(expected: Versions, got: Versions, threads: int, worker: str) -> None:
    """Raise JobsError unless a worker has our versions and one thread: a task needs its memory and threads alone."""
    check_versions(expected, got, f"worker {worker}")
    if threads != 1:
        remedy = "start more workers instead: `dask worker --nthreads 1 --nworkers N`"
        raise JobsError(
            "a worker has several threads", expected="1", got=threads, where=f"worker {worker}", remedy=remedy
        )


def _size(path: str) -> int | None:
    try:
        return Path(path).stat().st_size
    except OSError:
        return None
