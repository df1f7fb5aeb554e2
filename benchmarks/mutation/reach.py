"""A pytest plugin under `coverage run`: which test, and which fixture, reaches which line; how each test ends.

A fixture's lines belong to every test that asks for it, not only to the first one, which happens to set it up. Seconds
are those of the processor, so that a busy machine measures the same.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Generator
from pathlib import Path
from types import FrameType

import coverage
import pytest

FIXTURE = "fixture "
AGAIN_S = 5.0
"""After which a test that took no notice is told once more."""


class TooSlow(BaseException):
    """A test has had its time. No `Exception`: hypothesis would take it for a failure, and search a smaller one."""


_tests: dict[str, dict] = {}
_stack: list[str] = [""]


def _switch(context: str) -> None:
    current = coverage.Coverage.current()
    if current is not None:
        current.switch_context(context)


def _too_slow(number: int, frame: FrameType | None) -> None:
    if frame is None or Path(coverage.__file__).parent not in Path(frame.f_code.co_filename).parents:
        raise TooSlow  # never in the measuring itself, which may hold a lock: that test is told once more


def _processor_s() -> float:
    return sum(os.times()[:4])  # children that have ended, too


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Lines from here on belong to this test."""
    test = _tests[item.nodeid] = {
        "seconds": 0.0,
        "fixtures": list(getattr(item, "fixturenames", ())),
        "passed": True,
        "ran": False,
    }
    _stack[:] = [item.nodeid]
    _switch(item.nodeid)
    began_s = _processor_s()
    signal.signal(signal.SIGPROF, _too_slow)
    signal.setitimer(signal.ITIMER_PROF, float(os.environ["REACH_SLOWEST_S"]), AGAIN_S)  # this process's time only
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        test["seconds"] = round(_processor_s() - began_s, 3)
        _stack[:] = [""]
        _switch("")


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest
) -> Generator[None, object, object]:
    """Lines of a fixture's set-up belong to the fixture."""
    _stack.append(FIXTURE + fixturedef.argname)
    _switch(_stack[-1])
    try:
        return (yield)
    finally:
        _stack.pop()
        _switch(_stack[-1])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note how a phase of a test ended."""
    test = _tests[report.nodeid]
    test["passed"] &= not report.failed
    test["ran"] |= report.when == "call" and report.outcome == "passed"


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    Path(os.environ["REACH_TESTS"]).write_text(json.dumps(_tests), encoding="utf-8")
