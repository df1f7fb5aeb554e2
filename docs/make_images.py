"""The pictures of the modes in the docs: the app on a simulated rally, used as a person does, in headless Chromium.

    python -m docs.make_images [--out docs/images] [--only tune]

The rally is that of the film. `watch`, `tune`, `label`, `train` and `export` are written as PNG of 256 colours, and so
are `four`, a serve seen by four cameras, and the pictures of the steps in a lab (`docs/lab_pictures.py`), into
`your-lab/`.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import Page

from app.session import Session
from app.shared.workspace import Workspace
from app.state.commands import SetMethod
from core.cameras.presets import camera_preset
from core.errors import CommandError
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from docs.headless_app import show_app, still_picture, wait_for, wait_for_chain
from docs.lab_pictures import STEPS, LabRecordings, take_lab_pictures
from docs.make_film import SEED, play_rally

OUT: Final = Path("docs/images")
SPEED_MPS: Final = 5.0
COLOURS: Final = 256
BEFORE_HIT_US: Final = 120_000
"""The ball has bounced then, and its flight to the racket is predicted."""
FOUR: Final = "four"
"""Name of the recording of four cameras and of its picture."""
FOUR_US: Final = 360_000
"""A moment at which all four see the ball, and its flight is predicted."""


def main() -> None:
    """Take the pictures, and say how large they became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--only", choices=[*TAKE, FOUR, *STEPS])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(Path(folder))
        if arguments.only != FOUR:
            play_rally(workspace.recording_path("rally"), (SPEED_MPS,), SEED)
        if arguments.only is None or arguments.only in TAKE:
            with show_app(workspace, "rally") as (page, session):
                for name, take in TAKE.items():
                    if arguments.only in (None, name):
                        take(page, session)
                        save(still_picture(page), arguments.out / f"{name}.png")
        if arguments.only in (None, FOUR):
            cameras, config = camera_preset("corners"), StereoConfig(sensor=SensorConfig())
            simulate_recording(workspace.recording_path(FOUR), config, cameras, [LaunchConfig()], seed=SEED)
            with show_app(workspace, FOUR) as (page, session):
                take_four(page, session)
                save(still_picture(page), arguments.out / f"{FOUR}.png")
        if arguments.only is None or arguments.only in STEPS:
            recordings = LabRecordings(workspace, workspace.recording_path("rally"))
            for name, picture in take_lab_pictures(recordings, arguments.only):
                save(picture, arguments.out / "your-lab" / f"{name}.png")


def save(picture: Image.Image, path: Path) -> None:
    """Of few colours: a picture of a user interface has not many. Says how large it became."""
    path.parent.mkdir(exist_ok=True)
    picture.quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def enter(page: Page, session: Session, mode: str) -> None:
    """Press a mode's button."""
    page.get_by_role("button", name=mode, exact=True).first.click()
    wait_for(lambda: session.state is not None and session.state.mode == mode, mode)


def seek(page: Page, session: Session, t_us: int) -> None:
    """By the field of the time bar."""
    field = page.get_by_label("Time", exact=True)
    field.fill(str(t_us))
    field.press("Enter")
    field.blur()
    wait_for(lambda: session.state is not None and session.state.playhead.anchor_us == t_us, f"the cursor at {t_us} us")


def moment_us(session: Session) -> int:
    """Shortly before the ball is hit, on the grid of windows."""
    assert session.recording is not None and session.recording.ball is not None
    ball = session.recording.ball
    coming = ball.visible & (ball.v_world_mps[:, 0] < 0)
    if not coming.any():
        raise CommandError("no ball comes", where="the rally")
    return (int(ball.t_us[coming][-1]) - BEFORE_HIT_US) // 2000 * 2000


def take_watch(page: Page, session: Session) -> None:
    """The scene before the hit."""
    wait_for_chain(session)
    seek(page, session, moment_us(session))
    page.wait_for_timeout(2000)


def take_four(page: Page, session: Session) -> None:
    """A serve seen by four cameras: all their pictures, and all of them in the scene."""
    wait_for_chain(session)
    seek(page, session, FOUR_US)
    page.wait_for_timeout(2000)


def take_tune(page: Page, session: Session) -> None:
    """The stages of the window at the moment."""
    session.send(SetMethod("auto"))
    enter(page, session, "Tune")
    seek(page, session, moment_us(session))
    page.wait_for_timeout(2000)


def take_label(page: Page, session: Session) -> None:
    """Some proposals accepted by key."""
    enter(page, session, "Label")
    label = page.locator("label").filter(has_text="Annotator")
    label.locator("xpath=ancestor::*[.//input][1]").locator("input").last.fill("anna")
    page.get_by_text("anna").first.wait_for()
    seek(page, session, moment_us(session))
    page.evaluate("document.activeElement.blur()")  # keys mean labels then
    page.keyboard.press("8")  # ten times as large
    page.keyboard.press("i")
    for _ in range(100):  # until it is proposed, a key accepts nothing
        page.keyboard.press("Space")
        page.wait_for_timeout(1000)
        if page.get_by_text("6 labels").count():
            break
    page.get_by_text("proposing").first.wait_for(state="hidden")


def take_train(page: Page, session: Session) -> None:
    """A training that has ended."""
    enter(page, session, "Train")
    page.get_by_role("button", name="Train now", exact=True).click()
    page.get_by_label("Pace", exact=True).first.click()
    page.get_by_role("option", name="as fast as it goes", exact=True).click()
    page.get_by_text("ball 100 of 100").wait_for()
    page.wait_for_timeout(3000)


def take_export(page: Page, session: Session) -> None:
    """What can be exported."""
    enter(page, session, "Export")
    page.wait_for_timeout(2000)


TAKE: Final[dict[str, Callable[[Page, Session], None]]] = {
    "watch": take_watch,
    "tune": take_tune,
    "label": take_label,
    "train": take_train,
    "export": take_export,
}

if __name__ == "__main__":
    main()
