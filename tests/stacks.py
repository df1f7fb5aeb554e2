"""Where a test that hangs stands: the stacks of the children, beside those of its own threads by pytest-timeout."""

import subprocess
import sys
import threading
from collections.abc import Generator
from pathlib import Path

import psutil
import pytest
from pytest_timeout import Settings

BEFORE_S = 10.0
"""How long before its time is up a test's children are looked at: once it fails it ends them."""
TIMER = pytest.StashKey[threading.Timer]()
STACKS = pytest.StashKey[list[str]]()


def pytest_timeout_set_timer(item: pytest.Item, settings: Settings) -> None:
    """Look at the children of this process shortly before the time of the test is up."""
    if settings.timeout:
        item.stash[STACKS] = []
        wait_s = settings.timeout - min(BEFORE_S, settings.timeout / 2)
        item.stash[TIMER] = timer = threading.Timer(wait_s, note_children, [item.stash[STACKS]])
        timer.daemon = True
        timer.start()


def pytest_timeout_cancel_timer(item: pytest.Item) -> None:
    """Stop waiting for it."""
    if timer := item.stash.get(TIMER, None):
        timer.cancel()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add what was seen to the report of a test that failed."""
    report = yield
    if report.failed and (stacks := item.stash.get(STACKS, [])):
        report.sections.append(("stacks of child processes when the time was nearly up", "\n".join(stacks)))
    return report


def note_children(stacks: list[str]) -> None:
    """Append the stacks of every Python process below this one; of others their command line."""
    for child in psutil.Process().children(recursive=True):
        try:
            command = " ".join(child.cmdline())[:300]
            if "python" in child.name():
                stacks.append(f"{child.pid}: {command}\n{stacks_of(child.pid)}")
            else:
                stacks.append(f"{child.pid}: {command[:80]}")
        except psutil.Error:
            continue  # it has ended meanwhile


def stacks_of(pid: int) -> str:
    """Stacks of all threads of a Python process."""
    spy = Path(sys.executable).parent / "py-spy"
    try:
        done = subprocess.run([spy, "dump", "--pid", str(pid)], capture_output=True, text=True, timeout=BEFORE_S / 2)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"not to be had: {error}"
    return done.stdout or done.stderr
