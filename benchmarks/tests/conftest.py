"""Benchmarks measure, with small counts too, for longer than a test of the gate may take."""

from pathlib import Path

import pytest

from tests.waiting import PATIENCE_S

HERE = Path(__file__).parent
TIMEOUT_S = 6.0 * PATIENCE_S


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each test of a benchmark the time it may need."""
    for item in items:
        if item.path.is_relative_to(HERE) and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TIMEOUT_S))
