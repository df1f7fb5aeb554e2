"""Editors on recordings of two and of four cameras."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.modes.label.label_bench import FOUR, Bench


@pytest.fixture
def bench(tmp_path: Path, serve_recording: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "labels", serve_recording)
    yield bench
    bench.close()


@pytest.fixture
def four(tmp_path: Path, four_recording: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "labels", four_recording, FOUR)
    yield bench
    bench.close()
