"""Run before the tests: make sure that the browser tests have a Chromium, installing Debian's where possible."""

import os
import shutil
import subprocess
import sys


def main() -> int:
    if shutil.which("chromium") or os.environ.get("RALLYSCOPE_CHROMIUM"):
        return 0
    if shutil.which("apt-get") and os.geteuid() == 0:
        print("installing chromium for the browser tests")
        quiet = {"stdout": subprocess.DEVNULL, "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}}
        subprocess.run(["apt-get", "update", "-qq"], check=False, **quiet)
        if subprocess.run(["apt-get", "install", "-y", "-qq", "chromium"], check=False, **quiet).returncode == 0:
            return 0
    print("No chromium found: install it, or name one in RALLYSCOPE_CHROMIUM; browser tests are skipped without it.")
    return 1 if os.environ.get("CI") else 0


if __name__ == "__main__":
    sys.exit(main())
