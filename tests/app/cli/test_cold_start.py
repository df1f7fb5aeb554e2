"""A verb that computes, started where nothing has been compiled, or where nothing that is compiled can be kept.

The other verbs follow the first start of the app, in `browser/test_cold_start.py`.
"""

import os
import subprocess
import sys
from pathlib import Path

from tests.waiting import PATIENCE_S

CLI = [sys.executable, "-m", "app.cli"]


def run(arguments: list[str], cache: Path) -> subprocess.CompletedProcess:
    """A verb with a cache of compiled kernels that is not this user's."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run([*CLI, *arguments], capture_output=True, text=True, env=environment, timeout=PATIENCE_S)


def kernels(cache: Path) -> int:
    return len(list(cache.glob("**/*.kernel")))


def rows(path: Path) -> int:
    return len(path.read_text().splitlines()) - 1


def test_detect_where_nothing_has_been_compiled(serve_recording, tmp_path) -> None:
    cache, out = tmp_path / "kernels", tmp_path / "det.csv"
    done = run(["detect", str(serve_recording), "--camera", "left", "--out", str(out)], cache)
    assert done.returncode == 0, done.stderr
    assert rows(out) > 100
    assert kernels(cache) > 10
    assert "every start compiles again" not in done.stderr


def test_export_where_nothing_can_be_kept(serve_recording, tmp_path) -> None:
    """The verb with the fewest kernels: what happens to them is the same for every verb."""
    file = tmp_path / "file"
    file.touch()
    out = tmp_path / "events"
    arguments = ["export", str(serve_recording), "--evt3", str(out), "--end-us", "100000"]
    done = run(arguments, file / "cache")  # a folder cannot be made in a file
    assert done.returncode == 0, done.stderr
    assert out.exists()
    assert "every start compiles again" in done.stderr
