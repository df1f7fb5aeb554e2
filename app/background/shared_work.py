"""Work that several browsers ask for at about the same time, done once."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Generic, TypeVar

Request = TypeVar("Request")
Answer = TypeVar("Answer")


class SharedWork(Generic[Request, Answer]):
    """`compute(request)`, not done again for one of the latest keys. From any thread.

    Who asks for what is being computed waits for it. A failure is everybody's who waited, and is not kept.
    """

    def __init__(
        self, compute: Callable[[Request], Answer], key: Callable[[Request], Hashable], *, kept: int = 8
    ) -> None:
        self._compute, self._key, self._kept = compute, key, kept
        self._lock = threading.Lock()
        self._answers: OrderedDict[Hashable, Future[Answer]] = OrderedDict()

    def __call__(self, request: Request) -> Answer:
        """The answer, which must not be changed."""
        key, mine = self._key(request), Future[Answer]()
        with self._lock:
            known = self._answers.setdefault(key, mine)
            while len(self._answers) > self._kept:
                self._answers.popitem(last=False)
        if known is mine:
            self._work_out(request, key, mine)
        return known.result()

    def _work_out(self, request: Request, key: Hashable, mine: Future[Answer]) -> None:
        try:
            mine.set_result(self._compute(request))
        except Exception as error:  # noqa: BLE001 (all who wait hear of any)
            with self._lock:
                if self._answers.get(key) is mine:
                    del self._answers[key]
            mine.set_exception(error)
