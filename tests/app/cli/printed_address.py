"""The address of the page of an app that runs as a process."""

import re
import subprocess
from pathlib import Path

from tests.waiting import eventually


def address_in(log: Path, process: subprocess.Popen) -> str:
    """The address that the app prints, once it stands in this file; AssertionError if the app ends before."""

    def find() -> list[str]:
        assert process.poll() is None, log.read_text()
        return re.findall(r"http://\S+", log.read_text())

    return eventually(find, "the address of the page", log.read_text)[0]
