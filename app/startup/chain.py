"""`python -m app.startup.chain`: compile the chain, so that the app can load it compiled."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from app.background.child import send_to_parent
from core import jit
from core.files import end_with_parent
from core.live import warm_up as chain_warm_up

PACKAGES: Final = ("core.detection", "core.trajectory", "core.cameras", "core.chain", "core.outcomes")
TELL_EVERY_S: Final = 0.5


def marker() -> Path | None:
    """Marker file that exists if this code was compiled before; None if compiled code cannot be cached."""
    folder = jit.cache_folder()
    return None if folder is None else folder / f"chain-{jit.source_stamp(Path(chain_warm_up.__file__))}"


def compile_chain(on_progress: Callable[[int, int], None]) -> None:
    """Follow a painted ball with cameras, chain and controller as the live rally has them.

    `on_progress` hears from another thread how many kernels are ready, of about how many.
    """
    from core.cameras import stereo_preset
    from core.chain.chain import RallyChain
    from core.chain.config import ChainConfig
    from core.chain.control.controller import BuiltInController
    from core.chain.control.player import Player
    from core.live.live_player import LivePlayerConfig

    done = threading.Event()

    def tell() -> None:
        while not done.wait(TELL_EVERY_S):
            on_progress(*jit.kernels_ready(*PACKAGES))

    threading.Thread(target=tell, daemon=True).start()
    cameras = stereo_preset()
    # The chosen hit takes all that the plane does, and more.
    player = Player(RallyChain(cameras, ChainConfig()), BuiltInController(), hit="chosen")
    try:
        chain_warm_up.warm_up(player, cameras, LivePlayerConfig().window_us)
    finally:
        done.set()


def main() -> int:
    """Compile, print the progress, and write the marker."""
    end_with_parent()
    compile_chain(lambda ready, known: send_to_parent(f"{ready} of about {known} kernels"))
    place = marker()
    if place is not None:
        place.touch()
    return 0


if __name__ == "__main__":
    sys.exit(main())
