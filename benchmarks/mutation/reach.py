"""A pytest plugin under `coverage run`: which test, and which fixture, reaches which line; how each test ends.

A fixture's lines belong to every test that asks for it, not only to the first one, which happens to set it up.
"""

from __future__ import annotations

import json
import os
from collections.abc import Generator
from pathlib import Path

import coverage
import pytest

FIXTURE = "fixture "
_tests: dict[str, dict] = {}
_stack: list[str] = [""]


def _switch(context: str) -> None:
    current = coverage.Coverage.current()
    if current is not None:
        current.switch_context(context)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Lines from here on belong to this test."""
    _tests[item.nodeid] = {
        "seconds": 0.0,
        "fixtures": list(getattr(item, "fixturenames", ())),
        "passed": True,
        "ran": False,
    }
    _stack[:] = [item.nodeid]
    _switch(item.nodeid)
    try:
        return (yield)
    finally:
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
    """Note how a phase of a test ended and how long it took."""
    test = _tests[report.nodeid]
    test["seconds"] += report.duration
    test["passed"] &= not report.failed
    test["ran"] |= report.when == "call" and report.outcome == "passed"


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    Path(os.environ["REACH_TESTS"]).write_text(json.dumps(_tests), encoding="utf-8")
