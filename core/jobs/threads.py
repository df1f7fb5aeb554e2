"""One thread per worker process, also for torch: every core has its process already."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from threadpoolctl import threadpool_limits

VARIABLES: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""Read by libraries when they are loaded."""


@functools.cache
def use_one_thread() -> None:
    """Limit BLAS, OpenMP, torch and numba to one thread in this process, loaded already or later."""
    os.environ.update(dict.fromkeys(VARIABLES, "1"))
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = "1"
    else:
        sys.modules["numba"].set_num_threads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    threadpool_limits(1)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Context in which torch computes in the calling thread: a fixed order of sums, and all its time is counted."""
    torch = sys.modules["torch"]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
