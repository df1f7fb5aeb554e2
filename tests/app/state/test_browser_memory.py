"""What is kept for a browser: it comes back as it was, and a damaged file is as if there were none."""

import json
import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.shared.workspace import Workspace
from app.state import browser_memory
from app.state.browser_memory import BrowserMemory, Remembered, default_config
from app.state.client_state import Configs, History
from core.config import replace_setting
from core.detection import DetectorConfig

BROWSER = "0123456789abcdef" * 2


def history(method="auto", steps: int = 3) -> History[Configs]:
    base = default_config(method)
    found = History(Configs(base, base))
    for step in range(steps):
        edited = replace_setting(base, ("cluster", "eps_px"), 3.0 + 0.05 * step)
        found = found.change(Configs(edited, base), topic=None, wall_s=float(step))
    return found.undo()


def same(one: History[Configs], other: History[Configs]) -> bool:
    return (one.present, one.past, one.future) == (other.present, other.past, other.future)


def test_settings_come_back_with_their_undo_and_redo(tmp_path: Path) -> None:
    kept = Remembered(history(), {"refined": history("refined", 2)})
    BrowserMemory(Workspace(tmp_path)).keep(BROWSER, kept)
    back = BrowserMemory(Workspace(tmp_path)).recall(BROWSER)
    assert back is not None and same(back.configs, kept.configs)
    assert same(back.own_configs["refined"], kept.own_configs["refined"])
    assert back.configs.undo().redo() == back.configs


def test_only_so_many_steps_are_kept(tmp_path: Path) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    memory.keep(BROWSER, Remembered(history(steps=120)))
    back = memory.recall(BROWSER)
    assert back is not None and len(back.configs.past) == browser_memory.MAX_STEPS
    assert back.configs.past == history(steps=120).past[-browser_memory.MAX_STEPS :]


@pytest.mark.parametrize("browser", ["", "..", "../../x", "A" * 32, "0" * 31, "0" * 33, "0" * 31 + "/", "\0" * 32])
def test_a_name_that_is_none_of_ours_reads_and_writes_nothing(tmp_path: Path, browser: str) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    memory.keep(browser, Remembered(history()))
    assert memory.recall(browser) is None and not list(tmp_path.rglob("*.json"))


def test_settings_without_a_method_are_of_the_one_that_was_the_default_when_they_were_kept(tmp_path: Path) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    memory.keep(BROWSER, Remembered(history(), method="refined"))
    path = Workspace(tmp_path).browsers / f"{BROWSER}.json"
    content = json.loads(path.read_bytes())
    for stored, method in (("refined", "refined"), ("magic", "auto"), (None, "auto")):
        content["method"] = stored
        if stored is None:
            del content["method"]
        path.write_text(json.dumps(content))
        back = memory.recall(BROWSER)
        assert back is not None and back.method == method


def test_a_damaged_file_is_as_if_there_were_none(tmp_path: Path) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    memory.keep(BROWSER, Remembered(history()))
    path = Workspace(tmp_path).browsers / f"{BROWSER}.json"
    good, rng = path.read_bytes(), np.random.default_rng(1)
    for cut in rng.integers(0, len(good), 50):
        path.write_bytes(good[:cut])
        assert memory.recall(BROWSER) is None
    for content in (b"[]", b"{}", b'{"version": 2}', b'{"version": 1, "methods": {}}', b"[" * 100_000, b"\xff"):
        path.write_bytes(content)
        assert memory.recall(BROWSER) is None
    content = json.loads(good)
    content["methods"]["auto"]["present"][0]["cluster.eps_px"] = -1e9
    path.write_text(json.dumps(content))
    assert memory.recall(BROWSER) is None
    for _ in range(300):
        damaged = bytearray(good)
        for at in rng.integers(0, len(good), 3):
            damaged[at] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged))
        back = memory.recall(BROWSER)
        assert back is None or isinstance(back.configs.present.a, DetectorConfig)


def test_the_oldest_browsers_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(browser_memory, "MAX_BROWSERS", 3)
    memory = BrowserMemory(Workspace(tmp_path))
    names = [f"{number:032x}" for number in range(5)]
    for name in names:
        for path in Workspace(tmp_path).browsers.glob("*.json"):
            os.utime(path, (4e9, 4e9))  # as old as each other, and newer than the next: the clock was set back
        memory.keep(name, Remembered(history()))
        assert memory.recall(name) is not None, "the newest is never the one that is forgotten"
    assert [memory.recall(name) is not None for name in names].count(True) == 3


def test_a_folder_that_cannot_be_written_costs_the_settings_only(tmp_path: Path) -> None:
    (tmp_path / "browsers").write_text("a file in the way")
    memory = BrowserMemory(Workspace(tmp_path))
    memory.keep(BROWSER, Remembered(replace(history(), past=())))
    assert memory.recall(BROWSER) is None


def test_what_a_browser_has_seen_is_kept_beside_its_settings(tmp_path: Path) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    assert not memory.knows(BROWSER) and memory.seen(BROWSER) == frozenset()
    memory.note_seen(BROWSER, "tour")
    memory.note_seen(BROWSER, "another thing")
    again = BrowserMemory(Workspace(tmp_path))
    assert again.knows(BROWSER) and again.seen(BROWSER) == {"tour", "another thing"} and again.recall(BROWSER) is None
    again.keep(BROWSER, Remembered(history()))
    assert again.seen(BROWSER) == {"tour", "another thing"}


@pytest.mark.parametrize("browser", ["", "../../etc", "A" * 32, BROWSER + "0"])
def test_nothing_is_kept_for_a_name_that_no_cookie_of_ours_has(tmp_path: Path, browser: str) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    memory.note_seen(browser, "tour")
    assert not memory.knows(browser) and not memory.seen(browser) and not list(tmp_path.rglob("*.seen"))


def test_a_damaged_file_of_what_was_seen_does_no_harm(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    (workspace.browsers / f"{BROWSER}.seen").write_bytes(b"\xff\xfe\x00" * 100_000 + b"\n" * 1000)
    memory = BrowserMemory(workspace)
    assert len(memory.seen(BROWSER)) <= browser_memory.MAX_SEEN
    memory.note_seen(BROWSER, "tour")
    assert memory.knows(BROWSER)


def test_what_two_servers_note_of_one_browser_is_both_kept(tmp_path: Path) -> None:
    one, other = BrowserMemory(Workspace(tmp_path)), BrowserMemory(Workspace(tmp_path))
    threads = [
        threading.Thread(target=memory.note_seen, args=(BROWSER, f"{name}-{k}"))
        for k in range(10)
        for name, memory in (("one", one), ("other", other))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert one.seen(BROWSER) == other.seen(BROWSER) == {f"{name}-{k}" for name in ("one", "other") for k in range(10)}


def test_what_was_seen_grows_no_file_without_end(tmp_path: Path) -> None:
    memory = BrowserMemory(Workspace(tmp_path))
    for number in range(600):
        memory.note_seen(BROWSER, f"thing-{number:04d}")
    assert (tmp_path / "browsers" / f"{BROWSER}.seen").stat().st_size < 2 * browser_memory.MAX_SEEN_BYTES
    assert 0 < len(memory.seen(BROWSER)) <= browser_memory.MAX_SEEN
