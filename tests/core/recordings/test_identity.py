"""The identity of what is imported: its size, samples of its bytes and the choices, and nothing else."""

from pathlib import Path

import pytest

from core.recordings.import_feeds import ImportOrder, source_uuid
from core.recordings.sources.source import ImportOptions

SAMPLE = 64 << 10
LARGE = SAMPLE * 64 * 2 + 12_345
"""Of a file whose 64 samples of 64 KiB, spread evenly from its first to its last byte, leave out about a half."""


def sample_starts(size: int) -> list[int]:
    return [(size - SAMPLE) * number // 63 for number in range(64)]


def with_changed_byte(path: Path, at: int) -> str:
    """The identity with one byte changed, which is put back."""
    with path.open("r+b") as file:
        file.seek(at)
        before = file.read(1)
        for byte in (bytes([before[0] ^ 1]), before):
            file.seek(at)
            file.write(byte)
            file.flush()
            if byte != before:
                found = source_uuid([path])
    return found


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("identity") / "large"
    path.write_bytes(bytes(range(256)) * (LARGE // 256) + bytes(LARGE % 256))
    return path


def test_a_changed_byte_in_any_sample_is_another_recording(large: Path) -> None:
    known = source_uuid([large])
    starts = sample_starts(LARGE)
    assert starts[0] == 0 and starts[-1] + SAMPLE == LARGE
    for number in (0, 1, 31, 62, 63):
        for at in (starts[number], starts[number] + SAMPLE - 1):
            assert with_changed_byte(large, at) != known, f"sample {number}"
    assert source_uuid([large]) == known, "everything was put back"


def test_what_lies_between_two_samples_is_not_read(large: Path) -> None:
    known, starts = source_uuid([large]), sample_starts(LARGE)
    for number in (0, 31, 62):
        assert starts[number] + SAMPLE < starts[number + 1]
        assert with_changed_byte(large, starts[number] + SAMPLE) == known
        assert with_changed_byte(large, starts[number + 1] - 1) == known


@pytest.mark.parametrize("size", [1, 1000, SAMPLE, SAMPLE + 1])
def test_every_byte_of_a_small_file_counts(size: int, tmp_path: Path) -> None:
    path = tmp_path / "small"
    path.write_bytes(bytes(size))
    known = source_uuid([path])
    for at in {0, size // 2, size - 1}:
        assert with_changed_byte(path, at) != known
    path.write_bytes(bytes(size + 1))
    assert source_uuid([path]) != known, "its size counts too"


def test_order_number_and_choices_count_and_names_do_not(tmp_path: Path) -> None:
    one, other, same = (tmp_path / name for name in ("one", "other", "same"))
    one.write_bytes(b"left")
    other.write_bytes(b"right")
    same.write_bytes(b"left")
    known = source_uuid([one, other], "choice", 3)
    assert known == source_uuid([same, other], "choice", 3)
    others = [([other, one], ("choice", 3)), ([one], ("choice", 3)), ([one, other], ("choice", 4)), ([one, other], ())]
    assert known not in [source_uuid(paths, *choices) for paths, choices in others]
    (tmp_path / "empty").write_bytes(b"")
    assert source_uuid([tmp_path / "empty"]) != source_uuid([])


def test_an_identity_is_the_same_in_every_version(tmp_path: Path) -> None:
    """Labels on disk refer to it: this one was computed when it was first written down."""
    (tmp_path / "a").write_bytes(b"events")
    assert source_uuid([tmp_path / "a"], "raw") == "ae4d8772-af71-5142-b564-1e98c31340a2"
    order = ImportOrder([tmp_path / "a"], options=ImportOptions("ms", {"1": True, "2": False}))
    assert order.uuid(["camera"]) == "d2bfbb54-fa09-556c-9b6d-9d1b48a1d2b7", "so do the options of the import"
