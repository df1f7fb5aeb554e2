"""The cache of compiled kernels: never stale, shared by processes, and no condition for anything to work."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from core import jit

ROOT = Path(__file__).parents[2]
CALLER = "from rooms.called import twice\nfrom core.jit import njit\n\n@njit\ndef six():\n    return 2 + twice(2)\n"
CALLED = "from rooms.table import FACTOR\nfrom core.jit import njit\n\n@njit\ndef twice(x):\n    return FACTOR * x\n"
REPORT = (
    "import json, sys; sys.path.insert(0, sys.argv[1]); from rooms.caller import six; from core import jit;"
    "from numba.core import event; compiled = event.RecordingListener(); event.register('numba:compile', compiled);"
    "print(json.dumps([six(), len(compiled.buffer) // 2, jit.kernels_ready('rooms')]))"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package `rooms` with a kernel that calls a kernel of another file, which reads a constant of a third."""
    folder = tmp_path / "rooms"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "table.py").write_text("FACTOR = 2\n")
    (folder / "called.py").write_text(CALLED)
    (folder / "caller.py").write_text(CALLER)
    return tmp_path


def run(package: Path, cache: Path, **environment: str) -> tuple[int, int, list[int]]:
    """What `six()` gives in a process of its own, how many kernels that compiled, and (ready, known) kernels."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "0", **environment}
    command = [sys.executable, "-c", REPORT, str(package)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT, check=True)
    result, compiled, ready = json.loads(done.stdout)
    return result, compiled, ready


def test_a_second_process_compiles_nothing(package, tmp_path) -> None:
    assert run(package, tmp_path / "cache") == (6, 2, [2, 2])
    assert run(package, tmp_path / "cache") == (6, 0, [1, 2])  # the callee's code is inside the caller's


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [("called.py", "FACTOR * x", "FACTOR * x + 1"), ("table.py", "FACTOR = 2", "FACTOR = 2.5")],
)
@pytest.mark.gate
def test_an_edit_reaches_callers_in_other_files(package, tmp_path, file, before, after) -> None:
    assert run(package, tmp_path / "cache")[0] == 6
    source = package / "rooms" / file
    source.write_text(source.read_text().replace(before, after))
    assert run(package, tmp_path / "cache")[0] == 7
    source.write_text(source.read_text().replace(after, before))
    assert run(package, tmp_path / "cache")[:2] == (6, 0)  # what was compiled for the old text is still there


@pytest.mark.gate
def test_damaged_files_are_compiled_again(package, tmp_path) -> None:
    run(package, tmp_path / "cache")
    kept = list((tmp_path / "cache").rglob("*.kernel"))
    assert len(kept) == 2
    for number, path in enumerate(kept):
        data = path.read_bytes()
        path.write_bytes(data[:100] if number else data[:-1] + bytes([data[-1] ^ 1]))
    assert run(package, tmp_path / "cache")[:2] == (6, 2)


def test_without_a_place_to_keep_anything_it_works(package, tmp_path) -> None:
    nowhere = tmp_path / "file"
    nowhere.touch()  # a folder cannot be made below it, not even by root
    for _ in range(2):
        assert run(package, nowhere / "cache")[:2] == (6, 2)


def test_a_folder_that_others_may_write_to_is_not_used(package, tmp_path) -> None:
    folder = tmp_path / "cache" / "rallyscope-kernels"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    assert run(package, tmp_path / "cache")[0] == 6
    assert not list(folder.iterdir())


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o1777, True), (0o755, True)])
@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows has other rights")
def test_a_folder_below_one_that_others_may_write_to_is_not_used(mode, used, tmp_path, monkeypatch) -> None:
    above = tmp_path / "above"
    above.mkdir()
    above.chmod(mode)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(above / "cache"))
    assert jit.cache_folder.__wrapped__() == (above / "cache" / "rallyscope-kernels" if used else None)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows has other rights")
def test_a_link_to_the_cache_is_followed_once(tmp_path, monkeypatch) -> None:
    (tmp_path / "place").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "place")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "link"))
    assert jit.cache_folder.__wrapped__() == tmp_path.resolve() / "place" / "rallyscope-kernels"
