"""Turns in the interpreter and priorities of the threads between camera and robot."""

import gc
import os
import subprocess
import sys
import threading

import pytest

from core.live.urgency import NICENESS, TURN_S, freeze_loaded, go_first, shorten_turns


def test_turns_are_shorter_than_python_s_own() -> None:
    before = sys.getswitchinterval()
    try:
        shorten_turns()
        assert sys.getswitchinterval() == pytest.approx(TURN_S) and TURN_S < 0.005
    finally:
        sys.setswitchinterval(before)


def test_what_is_loaded_is_out_of_the_collectors_sight_and_what_comes_later_is_not() -> None:
    gc.unfreeze()
    freeze_loaded.cache_clear()
    try:
        freeze_loaded()
        frozen = gc.get_freeze_count()
        later = [[] for _ in range(1000)]
        freeze_loaded()
        assert frozen > 1000 and gc.get_freeze_count() <= frozen and len(later) == 1000
    finally:
        gc.unfreeze()


@pytest.mark.skipif(sys.platform != "linux", reason="threads have priorities of their own on Linux only")
def test_a_priority_is_that_of_the_thread_alone_and_a_refusal_is_no_error() -> None:
    mine = os.getpriority(os.PRIO_PROCESS, 0)
    found: list[tuple[bool, int]] = []

    def work() -> None:
        allowed = go_first()
        found.append((allowed, os.getpriority(os.PRIO_PROCESS, threading.get_native_id())))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    ((allowed, niceness),) = found
    assert niceness == (NICENESS if allowed else mine) and os.getpriority(os.PRIO_PROCESS, 0) == mine


@pytest.mark.skipif(sys.platform != "linux", reason="threads have priorities of their own on Linux only")
def test_what_an_urgent_thread_starts_is_not_urgent() -> None:
    mine = os.getpriority(os.PRIO_PROCESS, 0)
    own = "import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
    found: list[int] = []

    def work() -> None:
        allowed = go_first()
        thread = threading.Thread(target=lambda: found.append(os.getpriority(os.PRIO_PROCESS, 0)))
        thread.start()
        thread.join()
        said = subprocess.run([sys.executable, "-c", own], capture_output=True, text=True, check=True)
        found.extend([int(said.stdout), 0 if allowed else mine])

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    of_thread, of_process, normal = found
    assert of_thread == of_process == normal


def test_elsewhere_nothing_is_asked_of_the_system() -> None:
    code = "import sys; sys.platform = 'darwin'; from core.live.urgency import go_first; print(go_first())"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"
