"""Run before the tests: make sure that the browser tests have a Chromium, or say how to get one.

Any Chrome, Chromium or Edge that is installed will do, and so will playwright's own. Debian's is installed where that
needs nobody's leave.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

VARIABLE = "RALLYSCOPE_CHROMIUM"
NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
)
"""What the program is called on the PATH, by distribution and by maker."""
MAC_APPLICATIONS = ("Chromium", "Google Chrome", "Microsoft Edge", "Google Chrome for Testing")
PLAYWRIGHT_PATTERNS = (
    "chromium-*/chrome-linux*/chrome",
    *(f"chromium-*/chrome-mac*/{name}.app/Contents/MacOS/{name}" for name in MAC_APPLICATIONS),
    "chromium-*/chrome-win*/chrome.exe",
)
HELP = f"""No Chromium, Chrome or Edge was found, and none can be installed from here. Any of these helps:
  .venv/bin/playwright install chromium      needs neither root nor a package manager; works on macOS, too
  {VARIABLE}=/path/to/chrome make test       a browser that is somewhere else
  sudo apt-get install chromium              Debian and Ubuntu
Without one the browser tests are skipped; all others run."""


def find_chromium(
    environment: Mapping[str, str] | None = None, *, application_folders: Iterable[Path] | None = None
) -> Path | None:
    """The browser that `RALLYSCOPE_CHROMIUM` names, else one on the PATH, among macOS's applications, or playwright's.

    A name in the variable that leads to no program finds nothing: another browser than that would be a surprise.
    """
    environment = os.environ if environment is None else environment
    path = environment.get("PATH", os.defpath)
    if named := environment.get(VARIABLE):
        found = shutil.which(named, path=path)
        return Path(found) if found else None
    for name in NAMES:
        if found := shutil.which(name, path=path):
            return Path(found)
    home = Path(environment.get("HOME", os.path.expanduser("~")))
    for folder in application_folders or (Path("/Applications"), home / "Applications"):
        for name in MAC_APPLICATIONS:
            program = folder / f"{name}.app" / "Contents" / "MacOS" / name
            if program.is_file():
                return program
    own = environment.get("PLAYWRIGHT_BROWSERS_PATH")
    caches = [Path(own)] if own else [home / ".cache/ms-playwright", home / "Library/Caches/ms-playwright"]
    installed = (file for cache in caches for pattern in PLAYWRIGHT_PATTERNS for file in cache.glob(pattern))
    return max(installed, default=None)


def install_from_debian() -> bool:
    """Install Debian's Chromium where apt is there and may be used; whether that went well."""
    if not (shutil.which("apt-get") and hasattr(os, "geteuid") and os.geteuid() == 0):
        return False
    print("installing chromium for the browser tests")
    quiet = {"stdout": subprocess.DEVNULL, "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}}
    subprocess.run(["apt-get", "update", "-qq"], check=False, **quiet)
    return subprocess.run(["apt-get", "install", "-y", "-qq", "chromium"], check=False, **quiet).returncode == 0


def main() -> int:
    """0 if there is a browser now, or if doing without is allowed."""
    if find_chromium() is not None:
        return 0
    if os.environ.get(VARIABLE):
        print(f"{VARIABLE}={os.environ[VARIABLE]} is no program that can be started.")
    elif install_from_debian():
        return 0
    print(HELP)
    return 1 if os.environ.get("CI") else 0


if __name__ == "__main__":
    sys.exit(main())
