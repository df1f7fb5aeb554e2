"""Pictures made beside the chain: in other processes where there are many, because most of the work is Python."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from types import TracebackType
from typing import Final, Self

from app.export.rrd.camera_picture import CameraPicture, PictureJob, make_picture
from core.files import end_with_parent
from core.registry import load_plugin_files

WORKERS: Final = min(2, os.cpu_count() or 1)
WORTH_PROCESSES: Final = 1000
"""Fewer pictures than this are made before a new process has loaded its libraries."""
WAITING: Final = 128
"""Batches on their way at a time: bounds the memory."""
BATCH: Final = 16


class PicturePool:
    """Takes jobs in order and gives pictures back in the same order, under the key they were given with."""

    def __init__(self, expected: int) -> None:
        """For about `expected` pictures."""
        self._executor: Executor
        if expected >= WORTH_PROCESSES:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(WORKERS, mp_context=context, initializer=_start_process)
        else:
            self._executor = ThreadPoolExecutor(1, thread_name_prefix="export-picture")
        self._pending: deque[tuple[list[str], Future[list[CameraPicture]]]] = deque()
        self._keys: list[str] = []
        self._jobs: list[PictureJob] = []

    def submit(self, key: str, job: PictureJob) -> None:
        """Add a picture to make."""
        self._keys.append(key)
        self._jobs.append(job)
        if len(self._jobs) >= BATCH:
            self._send()

    def ready(self, *, everything: bool = False) -> list[tuple[str, CameraPicture]]:
        """Those that are made; with `everything`, wait for all of them."""
        if everything and self._jobs:
            self._send()
        found: list[tuple[str, CameraPicture]] = []
        while self._pending and (everything or len(self._pending) > WAITING or self._pending[0][1].done()):
            keys, future = self._pending.popleft()
            found += zip(keys, future.result(), strict=True)
        return found

    def _send(self) -> None:
        self._pending.append((self._keys, self._executor.submit(_make, self._jobs)))
        self._keys, self._jobs = [], []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)


def _start_process() -> None:
    end_with_parent()
    load_plugin_files()  # a job holds a config, which may have a plugin's section


def _make(jobs: list[PictureJob]) -> list[CameraPicture]:
    return [make_picture(job) for job in jobs]
