"""Pieces of work for tests, in a module that other processes can import."""

import os
import signal
from pathlib import Path

import numpy as np

from core.errors import ConfigError
from tests.waiting import eventually


def digest(seed, control):
    """Some arithmetic that BLAS would spread over threads, as bytes."""
    control(0.5)
    values = np.random.default_rng(seed).normal(size=(160, 160))
    return (values @ values.T).tobytes()


def slowly(piece, control):
    """Leaves a mark when it begins, waits for the file `go`, and says in which process it was."""
    folder, number = Path(piece[0]), piece[1]
    (folder / f"begun-{number}-{os.getpid()}").touch()

    def may_go() -> bool:
        control(0.5)
        return (folder / "go").exists()

    eventually(may_go, "the file `go`")
    return number


def until_stopped(piece, control):
    """Never ends by itself; leaves a mark when it is told to stop."""
    folder, number = Path(piece[0]), piece[1]
    (folder / f"begun-{number}-{os.getpid()}").touch()
    eventually(control.stopped, "to be stopped")
    (folder / f"stopped-{number}").touch()


def die_once(piece, control):
    """Killed the first time."""
    folder, number = Path(piece[0]), piece[1]
    mark = folder / f"died-{number}"
    if number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def die(number, control):
    """Number 1 kills every process that tries it."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail(number, control):
    """An error of the user's."""
    if number == 2:
        raise ConfigError("no such serve", expected="3 to 9", got=number)
    return number


def threads(number, control):
    """How many threads BLAS would use, and libraries that are loaded later."""
    from threadpoolctl import threadpool_info

    return max(pool["num_threads"] for pool in threadpool_info()), os.environ["OMP_NUM_THREADS"]
