"""Tests wait for states: how long something takes is for a benchmark to say."""

import ast
from collections.abc import Iterator

from tests.conftest import HERE

CLOCKS = {"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time"}
ALLOWED: dict[str, str] = {
    "waiting.py": "the one place that waits",
    "app/test_stopped_app.py": "how long the app stands is chosen by whoever runs it; nothing is asserted on it",
    "core/robot/test_robot_link.py": "a robot whose loop turns 500 times a second",
    "core/devices/replayed_hardware.py": "a camera that sends its packets when they are due",
}
"""Files that sleep or measure, and why."""


def clocks_of(text: str) -> list[int]:
    """Lines that sleep, or compare what a clock of `time` says; to hand a moment over is no measurement."""
    lines = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare):
            lines |= {call.lineno for call in direct_calls(node) if clock_name(call) in CLOCKS}
        elif isinstance(node, ast.Call) and clock_name(node) == "sleep":
            lines.add(node.lineno)
    return sorted(lines)


def direct_calls(node: ast.AST) -> Iterator[ast.Call]:
    """Calls below a node, without what stands in their arguments."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Call):
            yield child
        else:
            yield from direct_calls(child)


def clock_name(call: ast.Call) -> str | None:
    """`sleep` for `time.sleep(...)`; None for what is not of `time`."""
    function = call.func
    of_time = (
        isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == "time"
    )
    return function.attr if of_time else None


def test_no_test_looks_at_a_clock_or_sleeps():
    found = {path.relative_to(HERE).as_posix(): clocks_of(path.read_text()) for path in HERE.rglob("*.py")}
    looking = {name: lines for name, lines in found.items() if lines}
    assert looking.keys() <= ALLOWED.keys(), {name: looking[name] for name in looking.keys() - ALLOWED.keys()}
    assert ALLOWED.keys() <= looking.keys(), "it looks at no clock any more"


def test_a_clock_is_seen_where_there_is_one():
    text = "import time\ntime.sleep(1)\nassert time.monotonic() < 3\nsleep = 'time.sleep(1)'\nplay(time.monotonic())"
    assert clocks_of(text) == [2, 3]
