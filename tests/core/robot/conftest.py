"""A robot that is late: the example of the docs in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from core.robot import RobotClient, RobotWatchConfig
from tests.core.robot.starting import start_until_answered

ROOT = Path(__file__).parents[3]
LATE_ROBOT = Path(__file__).with_name("late_robot.py")
PATIENCE_S = 120.0


@contextmanager
def _late_robot(late_s: float) -> Iterator[RobotClient]:
    """So many seconds late, and started by a person."""
    process = subprocess.Popen(
        [sys.executable, str(LATE_ROBOT), str(late_s), "tcp://127.0.0.1:0"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    client = None
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        client = RobotClient(address, config=RobotWatchConfig(lost_ms=8000.0, slow_ms=3000.0))
        _wait_for(lambda: client.status.connection == "ready", "the robot")
        start_until_answered(client)
        _wait_for(lambda: client.status.ready, "the start")
        yield client
    finally:
        if client is not None:
            client.close()
        process.kill()
        process.wait()


def _wait_for(true: Callable[[], object], what: str) -> None:
    until = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < until, f"it did not happen in time: {what}"
        time.sleep(0.01)


@pytest.fixture
def late_robot() -> Callable[[float], AbstractContextManager[RobotClient]]:
    """Starts one."""
    return _late_robot


@pytest.fixture(name="wait_for")
def wait_for_fixture() -> Callable[[Callable[[], object], str], None]:
    """Returns once something is true."""
    return _wait_for
