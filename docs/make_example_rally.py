"""What the app shows while it is prepared: a small film on the page that loads, then a recorded rally in 3D.

    python -m docs.make_example_rally [--out app/startup/example_rally.npz] [--film app/web/page/rally.webp]

The film is that of the README (`docs.make_film`), smaller and with fewer pictures.

The rally is simulated like the one of the README (`docs.make_film.play_rally`): the racket is sent by the chain, which
sees nothing but simulated events.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

from PIL import Image

from app.shared.live_rally import positions
from app.shared.rallies import Rallies
from app.startup.example_rally import FILE, STRIDE_US, pack_pictures
from core.errors import CommandError
from core.history.rally_picture import RallyPicture
from core.recordings import open_recording
from docs.make_film import FRAMES_HZ, OUT, SEED, play_rally

SPEEDS_MPS: Final = (5.0, 6.0)
FILM_STEP: Final = 3
FILM_QUALITY: Final = 55
TRAIL_POINTS: Final = 60
LARGEST_BYTES: Final = 400_000


def main() -> None:
    """Make the file, and say how large it became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("app/startup") / FILE)
    parser.add_argument("--film", type=Path, default=Path("app/web/page/rally.webp"))
    arguments = parser.parse_args()
    out = arguments.out
    write_film(arguments.film)
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


def write_film(path: Path) -> None:
    """Write every FILM_STEP-th picture of the README's film, half as wide and high."""
    with Image.open(OUT) as film:
        size_px = (film.width // 2, film.height // 2)
        frames = []
        for number in range(0, getattr(film, "n_frames", 1), FILM_STEP):
            film.seek(number)
            frames.append(film.convert("RGB").resize(size_px, Image.Resampling.LANCZOS))
    duration_ms = round(1000 * FILM_STEP / FRAMES_HZ)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=duration_ms, loop=0, quality=FILM_QUALITY)
    print(f"{path}: {len(frames)} pictures, {path.stat().st_size / 1e3:.0f} kB")


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
