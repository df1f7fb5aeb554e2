"""How long a newcomer waits: `make run` in a fresh clone, with nothing compiled, beside busy processes.

    python -m benchmarks.app.measure_first_start [--clones 3] [--busy 4] [--folder "Möbel & Bälle"] [--python PYTHON]

For each clone one line: seconds from the end of the installation to the page's address, and in the browser to the card,
to the recorded rally over the table and to the first returned ball. Everything that a start could have warmed is put
into a folder of its own.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.app.bare_browser import WINDOW, measuring_browser

ROOT = Path(__file__).parents[2]
GIVE_UP_S = 1800.0
DRAWN = """() => !("rallyscopeSplash" in document.documentElement.dataset)
  && new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"""
"""Whether the page has let its film go, and has drawn two pictures since."""


def main() -> None:
    """Measure, clone after clone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clones", type=int, default=3)
    parser.add_argument("--busy", type=int, default=4, help="busy processes beside it")
    parser.add_argument("--folder", default="clone", help="name of the folder that is cloned into")
    parser.add_argument("--python", default=sys.executable, help="the interpreter that makes the environment")
    parser.add_argument("--port", type=int, default=18_080)
    arguments = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(arguments.busy)]
    try:
        for number in range(arguments.clones):
            with tempfile.TemporaryDirectory(prefix="first-start-") as home:
                measure(Path(home), arguments, number)
    finally:
        for process in busy:
            process.kill()


def measure(home: Path, arguments: argparse.Namespace, number: int) -> None:
    """One clone: prints its line."""
    clone = home / arguments.folder
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    caches = {"XDG_CACHE_HOME": str(home / "cache"), "PYTHONDONTWRITEBYTECODE": ""}
    environment = {key: value for key, value in os.environ.items() if key not in ("VIRTUAL_ENV", "NUMBA_CACHE_DIR")}
    command = ["make", "run", f"PORT={arguments.port}", f"PYTHON={arguments.python}"]
    log, began_s = home / "log", time.monotonic()
    with log.open("w", encoding="utf-8") as out:
        started = subprocess.Popen(
            command, cwd=clone, env=environment | caches, stdout=out, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        until(lambda: (clone / ".venv" / ".installed").exists(), started, log)
        installed_s = time.monotonic()
        until(lambda: "http://" in log.read_text("utf-8"), started, log)
        seconds = {"page": time.monotonic() - installed_s} | in_browser(arguments.port, installed_s, started, log)
        told = ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items())
        print(f"clone {number + 1}: installation {installed_s - began_s:.0f} s, then {told}", flush=True)
        print(
            "".join(f"    {line}\n" for line in log.read_text("utf-8").splitlines() if ": done after" in line), end=""
        )
    finally:
        os.killpg(started.pid, signal.SIGINT)
        started.wait(300)
        shutil.copy(log, Path(tempfile.gettempdir()) / f"first-start-{number + 1}.log")


def in_browser(port: int, installed_s: float, started: subprocess.Popen, log: Path) -> dict[str, float]:
    """Seconds from the installation's end to what a browser shows."""
    seconds = {}
    with measuring_browser() as browser:
        page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
        page.goto(f"http://127.0.0.1:{port}", timeout=600_000)
        for name, words in (("card", r"Getting ready"), ("returned ball", r"^[1-9]\d* of \d+$")):
            shown = page.get_by_text(re.compile(words))
            until(lambda shown=shown: shown.count() > 0, started, log)
            seconds[name] = time.monotonic() - installed_s
            if name == "card":
                page.wait_for_function(DRAWN, timeout=600_000)
                seconds["recorded rally"] = time.monotonic() - installed_s
        page.screenshot(path=str(Path(tempfile.gettempdir()) / "first-start.png"), timeout=120_000)
    return seconds


def until(condition: Callable[[], bool], started: subprocess.Popen, log: Path) -> None:
    """Wait for it while the started command lives."""
    deadline = time.monotonic() + GIVE_UP_S
    while not condition():
        assert started.poll() is None and time.monotonic() < deadline, log.read_text("utf-8")
        time.sleep(0.1)


if __name__ == "__main__":
    main()
