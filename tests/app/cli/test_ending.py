"""A verb that waits for its end hears of it, whichever thread the signal arrives in."""

import subprocess
import sys

import pytest

from tests.waiting import PATIENCE_S

WAITS = """
import signal, sys, threading, time
from pathlib import Path
from app.cli.ending import end_event

ended, main = end_event(), threading.main_thread()

def send():
    state = Path(f"/proc/self/task/{main.native_id}/stat")
    asleep = 0
    while asleep < 20:  # asleep at every look: it waits for the end, and for nothing else
        time.sleep(0.005)
        waits = sys._current_frames()[main.ident].f_code.co_name == "wait"
        asleep = asleep + 1 if waits and state.read_text().rpartition(")")[2].split()[0] == "S" else 0
    target = threading.get_ident() if sys.argv[1] == "another" else main.ident
    signal.pthread_kill(target, getattr(signal, sys.argv[2]))

threading.Thread(target=send, daemon=True).start()
assert ended.wait() and ended.is_set() and ended.wait(0.0)
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("thread", ["the main", "another"])
def test_a_signal_ends_the_waiting_whichever_thread_gets_it(thread: str, name: str) -> None:
    command = [sys.executable, "-c", WAITS, thread, name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr


def test_waiting_for_a_time_and_other_signals_end_nothing() -> None:
    code = """
import os, signal
from app.cli.ending import end_event

ended, heard = end_event(), []
signal.signal(signal.SIGUSR1, lambda *_: heard.append(1))
os.kill(os.getpid(), signal.SIGUSR1)
assert not ended.wait(0.01) and heard and not ended.is_set()
os.kill(os.getpid(), signal.SIGTERM)
assert ended.wait()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
