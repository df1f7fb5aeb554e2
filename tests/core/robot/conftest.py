"""A robot that is late: the example of the docs in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from core.robot import RobotClient, RobotWatchConfig
from tests.core.robot.starting import start_until_answered
from tests.waiting import PATIENCE_S, eventually

ROOT = Path(__file__).parents[3]
LATE_ROBOT = Path(__file__).with_name("late_robot.py")


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
        eventually(lambda: client.status.connection == "ready", "the robot", lambda: client.status)
        start_until_answered(client)
        eventually(lambda: client.status.ready, "the start", lambda: client.status)
        yield client
    finally:
        if client is not None:
            client.close()
        process.kill()
        process.wait(PATIENCE_S)


@pytest.fixture
def late_robot() -> Callable[[float], AbstractContextManager[RobotClient]]:
    """Starts one."""
    return _late_robot
