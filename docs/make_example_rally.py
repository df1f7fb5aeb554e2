"""The recorded rally that the app shows while it is prepared (`app/startup/example_rally.py`).

    python -m docs.make_example_rally [--out app/startup/example_rally.npz]

The rally is simulated like the one of the README (`docs.make_film.play_rally`): the racket is sent by the chain, which
sees nothing but simulated events.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

from app.shared.live_rally import positions
from app.shared.rallies import Rallies
from app.startup.example_rally import FILE, STRIDE_US, pack_pictures
from core.errors import CommandError
from core.history.rally_picture import RallyPicture
from core.recordings import open_recording
from docs.make_film import SEED, play_rally

SPEEDS_MPS: Final = (5.0, 6.0)
TRAIL_POINTS: Final = 60
LARGEST_BYTES: Final = 400_000


def main() -> None:
    """Make the file, and say how large it became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("app/startup") / FILE)
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rally.h5"
        print(f"The rally's balls: {', '.join(play_rally(path, SPEEDS_MPS, SEED))}")
        pictures = pictures_of(path)
    data = pack_pictures(pictures)
    if len(data) > LARGEST_BYTES:
        raise CommandError(
            "too large to come with the app", expected=f"at most {LARGEST_BYTES:,}", got=f"{len(data):,}"
        )
    out.write_bytes(data)
    print(f"{out}: {len(pictures)} pictures, {len(data) / 1e3:.0f} kB")


def pictures_of(path: Path) -> list[RallyPicture]:
    """Pictures of a recording, as Watch draws them, STRIDE_US apart; trails have at most TRAIL_POINTS points."""
    rallies = Rallies()
    with open_recording(path) as recording:
        rally = rallies.of(recording)
        assert rally is not None and rally.following is not None
        rally.following.wait()
        cameras = positions(rally.cameras)
        found = [rally.history.at(t_us, cameras).picture for t_us in range(0, recording.duration_us, STRIDE_US)]
        rallies.close()
    return [_thinned(picture) for picture in found]


def _thinned(picture: RallyPicture) -> RallyPicture:
    step = -(-max(1, len(picture.trail)) // TRAIL_POINTS)
    return replace(
        picture, trail=picture.trail[::-step][::-1], trail_speeds_mps=picture.trail_speeds_mps[::-step][::-1]
    )


if __name__ == "__main__":
    main()
