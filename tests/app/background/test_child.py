import gc
import threading
import warnings

import pytest

from app.background.child import ChildProcess, share_in
from tests.waiting import PATIENCE_S


def test_what_a_child_says_is_heard_line_by_line_and_its_end_is_told() -> None:
    lines: list[str] = []
    ended = threading.Event()
    child = ChildProcess("app.cli", "info", "no-such-file.h5", on_line=lines.append, on_end=ended.set)
    assert child.wait() == 2 and ended.is_set()
    assert len(lines) == 1 and child.last_words == lines[0] and "no-such-file.h5" in lines[0]


def test_a_child_that_is_stopped_leaves_nothing_open() -> None:
    gc.collect()  # what other tests left open is not its own
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        ended = threading.Event()
        child = ChildProcess("json.tool", on_end=ended.set)  # which waits for its input
        child.stop()
        assert ended.wait(PATIENCE_S) and child.wait() != 0
        del child
        gc.collect()
    assert [str(one.message) for one in seen] == []


@pytest.mark.parametrize(
    ("line", "share"),
    [("31 of about 62 kernels", 0.5), ("3 of 4 trials", 0.75), ("5 of 4", 1.0), ("of", None), ("1 of 0", None)],
)
def test_a_line_says_how_much_is_done(line: str, share: float | None) -> None:
    assert share_in(line) == share
