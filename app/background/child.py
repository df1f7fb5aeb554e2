"""One of our verbs or modules as a child process, whose output is read line by line.

It ends with its parent if it calls `core.files.end_with_parent`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

REMEMBERED_LINES: Final = 20
NICENESS: Final = 5
_SHARE = re.compile(r"(\d+) of (?:about )?(\d+)")


class ChildProcess:
    """Starts at once; its output is read on a thread of its own."""

    def __init__(
        self,
        *command: str,
        on_line: Callable[[str], None] = lambda line: None,
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        """`command` follows `python -m`; `on_line` gets every line of output and errors, `on_end` is called at the
        end.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", *command],  # -P: nothing of the working folder is imported
            stdin=subprocess.PIPE,  # ends with this process, however that ends, and so does the child
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            # Ctrl-C in the app's terminal does not reach it: the app ends it. And Linux shares the processor among
            # sessions first: it gets a share of its own beside a browser.
            start_new_session=True,
        )
        self._on_line, self._on_end = on_line, on_end
        self._lines: deque[str] = deque(maxlen=REMEMBERED_LINES)
        self._reader = threading.Thread(target=self._read, name="child-process", daemon=True)
        self._reader.start()

    @property
    def is_alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def last_words(self) -> str:
        """Last line of its output."""
        return self._lines[-1] if self._lines else "no output"

    def wait(self) -> int:
        """Wait for its end, read all its output, and return its exit code."""
        code = self._process.wait()
        self._reader.join()
        self._close_input()
        return code

    def stop(self) -> None:
        """End the process, politely first."""
        self._process.terminate()
        try:
            self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close_input()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            for line in output:
                if line.strip():
                    self._lines.append(line.strip())
                    self._on_line(line.strip())
        self._on_end()

    def _close_input(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()


def give_way() -> None:
    """In the child: lower its own priority, so that app and browser go first, where the system has priorities."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)


def send_to_parent(line: str) -> None:
    """In the child: print a line and flush."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def share_in(line: str) -> float | None:
    """Progress in a line such as "31 of about 75 kernels", 0 to 1; None if the line has none."""
    found = _SHARE.search(line)
    if found is None or int(found.group(2)) == 0:
        return None
    return min(1.0, int(found.group(1)) / int(found.group(2)))
