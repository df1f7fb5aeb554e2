from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from core.errors import LabelError
from labels.journal import Journal, read_journal
from labels.model import Label, LabelState
from labels.records import is_whole, pack_line, unpack_line
from labels.store import LabelStore


def make(path: Path, count: int) -> bytes:
    journal, _ = Journal.open(path)
    for index in range(count):
        journal.append({"seq": index, "text": "ü" * index})
    journal.close()
    return path.read_bytes()


def test_a_journal_cut_anywhere_gives_every_line_before_the_cut_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    content = make(path, 4)
    for cut in range(len(content) + 1):
        path.write_bytes(content[:cut])
        journal, lines = Journal.open(path)
        whole = content[:cut].count(b"\n")
        assert [record["seq"] for record in lines.records] == list(range(whole))
        assert lines.damaged == ()
        journal.append({"seq": 99})
        journal.close()
        assert [record["seq"] for record in read_journal(path).records] == [*range(whole), 99]


@pytest.mark.parametrize("tail", [b"\0" * 500, b"\xff\xfe{", b'{"seq":7}\n', b"\n\n\n"])
def test_rubbish_behind_the_last_line_is_cut_off(tmp_path: Path, tail: bytes) -> None:
    path = tmp_path / "a.jsonl"
    content = make(path, 3)
    path.write_bytes(content + tail)
    journal, lines = Journal.open(path)
    journal.close()
    assert len(lines.whole) == 3
    assert path.read_bytes() == content


def test_a_damaged_line_in_the_middle_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    content = bytearray(make(path, 4))
    second = content.index(b"\n") + 3
    content[second] ^= 0x04
    path.write_bytes(content)
    lines = read_journal(path)
    assert [record["seq"] for record in lines.records] == [0, 2, 3]
    assert lines.damaged == (2,)


def test_the_store_tells_of_damage_and_shows_what_is_left(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, "u", "left", "anna") as store:
        for t_us in (1, 2, 3):
            store.put(Label(t_us=t_us, state=LabelState.NO_BALL))
        path = store.path
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[1] + lines[2].replace(b"no_ball", b"mo_ball") + lines[3])
    with LabelStore.open(tmp_path, "u", "left", "anna") as store:
        assert store.labels().t_us.tolist() == [1, 3]
        assert store.notes == (f"{path}:3: damaged line, left out",)


@pytest.mark.parametrize("flip", range(0, 60, 7))
def test_a_changed_byte_is_noticed(flip: int) -> None:
    line = bytearray(pack_line({"seq": 1, "put": [], "delete": [123456], "by": "anna"})[:-1])
    assert is_whole(bytes(line))
    assert unpack_line(bytes(line))["by"] == "anna"
    line[flip] ^= 0x01
    assert not is_whole(bytes(line))


FILL = """
import resource, signal, sys
from pathlib import Path
from core.errors import LabelError
from labels.model import Label, LabelState
from labels.store import LabelStore
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
store = LabelStore.open(Path(sys.argv[1]), "u", "left", "anna")
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
saved = 0
try:
    for t_us in range(10**6):
        store.put(Label(t_us=t_us, state=LabelState.NO_BALL))
        saved += 1
except LabelError as error:
    print(error)
assert len(store.labels()) == saved, "memory holds what is not saved"
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
store.put(Label(t_us=saved, state=LabelState.NO_BALL))
print(saved)
"""


def test_a_full_disk_is_one_clear_error_and_loses_nothing(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", FILL, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    message, saved = done.stdout.splitlines()
    assert "not saved" in message
    assert "anna.jsonl" in message
    with LabelStore.open(tmp_path, "u", "left", "anna") as store:
        assert store.labels().t_us.tolist() == list(range(int(saved) + 1))
        assert store.notes == ()


def test_two_writers_of_one_journal_are_refused(tmp_path: Path) -> None:
    journal, _ = Journal.open(tmp_path / "a.jsonl")
    with pytest.raises(LabelError, match="another program"):
        Journal.open(tmp_path / "a.jsonl")
    journal.close()
    Journal.open(tmp_path / "a.jsonl")[0].close()


def test_a_journal_that_is_a_folder_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").mkdir()
    with pytest.raises(LabelError, match="cannot write labels here"):
        Journal.open(tmp_path / "a.jsonl")
    with pytest.raises(LabelError, match="cannot read"):
        read_journal(tmp_path / "a.jsonl")
