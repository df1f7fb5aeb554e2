"""The simulated sample recordings that come with the app.

    python -m docs.make_samples [--out app/samples]

Each is what `rallyscope simulate` makes with the arguments of `SAMPLES`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from app.cli.main import main as run_verb
from core.errors import CommandError

SAMPLES: Final = {
    "two-throws": "--serves 2 --speed 5 --sensor 480x270 --seed 7",
    "thrower": "--scene person --serves 1 --speed 4 --sensor 320x180 --seed 3",
}
LARGEST_BYTES: Final = 3_000_000
"""Of all together: every installation carries them."""


def main() -> None:
    """Make the files, and say how large they became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("app/samples"))
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name, arguments in SAMPLES.items():
        if run_verb(["simulate", "--out", str(folder / f"{name}.h5"), "--force", *arguments.split()]):
            raise CommandError("a sample was not made", where=name)
    total = sum(path.stat().st_size for path in folder.glob("*.h5"))
    if total > LARGEST_BYTES:
        raise CommandError("too large to come with the app", expected=f"{LARGEST_BYTES:,}", got=f"{total:,}")
    print(f"{folder}: {total / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
