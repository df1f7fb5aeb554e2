"""The film of the README: a rally that the robot plays by what its cameras see, in the app, in headless Chromium.

    python -m docs.make_film [--out docs/images/rally.webp] [--seconds 10] [--frames-hz 12.5]

The rally is simulated first (`play_rally`), from a fixed seed and as fast as it goes: the racket is sent by the chain,
which sees nothing but events. Then the app opens the recording, and every frame is a screenshot of one moment.
"""

from __future__ import annotations

import argparse
import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image
from playwright.sync_api import Page

from app.modes.watch.commands import ShowLayer
from app.session import Session
from app.shared.workspace import Workspace
from app.state.commands import Seek
from core.cameras import stereo_preset
from core.chain import ChainConfig, RallyChain
from core.chain.config import chain_for_physics
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.detection.window import block_windows
from core.errors import CommandError
from core.history.recorded_rally import RACKET, TARGETS, racket_rows, target_rows
from core.live.worlds.world import Block, SimulatedWorld, WorldConfig
from core.recordings import RecordingWriter
from docs.headless_app import show_app, still_picture, wait_for, wait_for_chain

OUT: Final = Path("docs/images/rally.webp")
SEED: Final = 11
SPEEDS_MPS: Final = (5.0, 7.0)
FILM_S: Final = 10.0
FRAMES_HZ: Final = 12.5
LARGEST_BYTES: Final = 5_000_000
WINDOW_US: Final = 2000
AFTER_US: Final = 350_000
"""From the end of a ball to the next serve: it leaves the picture, and the racket goes back to its place."""
LONGEST_BALL_US: Final = 3_000_000
FIRST_US: Final = 40_000
"""Of the recording in the film: by then the first ball has been seen, and its flight predicted."""
SHOWN_PX: Final = (0, 0, 876, 720)
"""Left, top, right and bottom of what the film shows of the window: all but the controls."""
QUALITY: Final = 80


@dataclass(frozen=True, slots=True)
class FilmPlan:
    """How long the film is, and how many pictures it has a second."""

    seconds: float = FILM_S
    frames_hz: float = FRAMES_HZ

    @property
    def frame_ms(self) -> int:
        """How long one picture stands."""
        return round(1000 / self.frames_hz)

    def moments_us(self, start_us: int, end_us: int) -> list[int]:
        """The recording's times of all pictures, evenly over the part that is filmed."""
        count = max(2, round(1000 * self.seconds / self.frame_ms))
        return np.linspace(start_us, end_us, count, endpoint=False).astype(np.int64).tolist()


def main() -> None:
    """Make the film, and say how large it became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--seconds", type=float, default=FILM_S)
    parser.add_argument("--frames-hz", type=float, default=FRAMES_HZ)
    arguments = parser.parse_args()
    plan = FilmPlan(arguments.seconds, arguments.frames_hz)
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(Path(folder))
        cases = play_rally(workspace.recording_path("rally"), SPEEDS_MPS, SEED)
        print(f"The rally's balls: {', '.join(cases)}")
        frames = film_recording(workspace, "rally", plan, lambda share: print(f"\r{share:4.0%}", end="", flush=True))
    data = webp_of(frames, plan.frame_ms)
    if len(data) > LARGEST_BYTES:
        raise CommandError("the film is too large", expected=f"at most {LARGEST_BYTES:,} bytes", got=f"{len(data):,}")
    arguments.out.write_bytes(data)
    print(f"\r{arguments.out}: {len(frames)} pictures, {plan.seconds:g} s, {len(data) / 1e6:.2f} MB")


def play_rally(path: Path, speeds_mps: Sequence[float], seed: int) -> list[str]:
    """Write a recording of one serve per speed, answered by what the chain sees. Returns what came of each ball."""
    cameras = stereo_preset()
    config = WorldConfig()
    world = SimulatedWorld(config, cameras, seed)
    chain = RallyChain(cameras, chain_for_physics(ChainConfig(), config.task.physics))
    player = Player(chain, BuiltInController(config.task))
    cases: list[str] = []
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    try:
        with RecordingWriter(path, sensors, calibration=cameras, seed=seed) as writer:
            for speed_mps in speeds_mps:
                world.draw_serve(speed_mps)
                player.forget_flight()
                cases.append(_play_ball(world, player, writer))
            writer.extend_duration(world.now_us)
    finally:
        world.close()
    return cases


def _play_ball(world: SimulatedWorld, player: Player, writer: RecordingWriter) -> str:
    """Until a while after its outcome; says which that was."""
    case, end_us = "", world.now_us + LONGEST_BALL_US
    while world.now_us < end_us:
        block = world.advance()
        _write(writer, block)
        for windows in block_windows(block.events, block.start_us, block.end_us, WINDOW_US):
            state = player.step(windows)
            found = state.decision
            if found is not None and state.is_new and found.target.t_s > world.now_us * 1e-6:
                world.aim(found.target)
                writer.append_rows(TARGETS, target_rows(found, 0))
        for judged in block.outcomes:
            case, end_us = judged.outcome.case.name.lower(), world.now_us + AFTER_US
    return case


def _write(writer: RecordingWriter, block: Block) -> None:
    for name, events in block.events.items():
        writer.append(name, events)
        writer.write_truth(name, block.circles[name])
    writer.write_ball(block.ball)
    writer.append_rows(RACKET, racket_rows(block, 0))


def film_recording(
    workspace: Workspace, name: str, plan: FilmPlan, progress: Callable[[float], None]
) -> list[Image.Image]:
    """Screenshots of the app's Watch mode, one for each moment of a stereo recording of the workspace.

    Raises:
        CommandError: if there is no browser, or the app does not show a moment in time.
    """
    with _watching(workspace, name) as (page, session):
        assert session.recording is not None
        moments_us = plan.moments_us(FIRST_US, session.recording.duration_us)
        frames: list[Image.Image] = []
        for number, t_us in enumerate(moments_us):
            session.send(Seek(t_us))
            shown = page.locator("#rallyscope-us")
            wait_for(lambda shown=shown, t_us=t_us: shown.inner_text() == f"{t_us} µs", f"the cursor at {t_us} us")
            frames.append(still_picture(page).crop(SHOWN_PX))
            progress((number + 1) / len(moments_us))
        return frames


@contextmanager
def _watching(workspace: Workspace, name: str) -> Iterator[tuple[Page, Session]]:
    """A browser that shows the recording in 3D, once the chain has seen all of it."""
    with show_app(workspace, name) as (page, session):
        wait_for(lambda: session.world.visible, "the 3D scene")
        wait_for_chain(session)
        session.send(ShowLayer("True ball", False))
        page.wait_for_timeout(2000)  # the camera comes to rest; every picture is waited for on its own
        yield page, session


def webp_of(frames: Sequence[Image.Image], frame_ms: int, quality: int = QUALITY) -> bytes:
    """An animated WebP that begins again at its end."""
    out = io.BytesIO()
    first, *others = frames
    first.save(out, "WEBP", save_all=True, append_images=others, duration=frame_ms, loop=0, quality=quality, method=4)
    return out.getvalue()


if __name__ == "__main__":
    main()
