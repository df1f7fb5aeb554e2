"""A scripted person who labels in a real browser, through the screen and the keyboard alone, and is interrupted once.

It takes what is proposed, and every tenth time clicks on the ball instead, where the simulation says that it is; it
does not think. In the middle the server is killed (SIGKILL) and started again.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from app.modes.label.label_picture import GAP_PX, HEIGHT_PX, MAIN_WIDTH_PX, choose_side_layout
from app.modes.label.labelling import DEFAULT_STEP_US
from app.views.image_view import framing, free_share
from benchmarks.app.bare_browser import WINDOW, measuring_browser
from benchmarks.app.label_user_exports import check_exports, checks_text
from core.cameras import stereo_preset
from core.recordings import PixelTruth, open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from labels.formats import LabelSet
from labels.store import LabelStore, Layer

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CAMERA: Final = "left"
ANNOTATOR: Final = "trial-user"
CLICK_EVERY: Final = 10
LINES_JS: Final = (
    "[...document.querySelectorAll('div[style^=\"font-size:12.5px\"]')].map(one => one.textContent).join()"
)
"""What the app says in words; reading it lays nothing out, which would cost more than what is measured."""
COUNT_JS: Final = f"+({LINES_JS}.match(/times checked, (\\d+) labels?/) || [0, -1])[1]"
SCORED_JS: Final = f"+({LINES_JS}.match(/against (\\d+) labels by/) || [0, 0])[1]"
TIME_JS: Final = "parseInt(document.getElementById('rallyscope-us').textContent)"
PATIENCE_MS: Final = 2500
HAND_MS: Final = 120
"""From one field to the next: of what is changed within 50 ms viser sends only the last control's."""
READ_WITHIN_S: Final = 60.0
MAX_PASSED_OVER: Final = 10
"""Times in a row that cannot be judged, before something is wrong with the page and not with the picture."""


@dataclass(frozen=True, slots=True)
class UserResult:
    """What came of it."""

    labels: int
    accepted: int
    clicked: int
    decisions_per_minute: float
    before_kill: int
    """Labels that the screen had called saved when the server was killed."""
    lost: int
    """Of those, gone afterwards."""
    median_error_px: float
    formats: str
    """Every reader with its worst error."""
    formats_failed: int
    scored_labels: int
    """That Tune has scored the config against."""


def label_with_browser(folder: Path, count: int, *, seed: int = 1, browser: Browser | None = None) -> UserResult:
    """Simulate a recording, label `count` centres in it, export them, and score the detector on them.

    Without a `browser` one is started for it.
    """
    if browser is None:
        with measuring_browser() as own:
            return label_with_browser(folder, count, seed=seed, browser=own)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "trial.h5"
    serves = [LaunchConfig()] * (1 + count // 150)
    simulate_recording(file, StereoConfig(sensor=SensorConfig()), stereo_preset(), serves, seed=seed)
    page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
    user = _User(folder, file, page)
    try:
        user.work(count)
        scored = user.score()
    finally:
        user.leave()
        page.close()
    return _result(folder, file, user, scored)


class _User:
    """At one screen."""

    def __init__(self, folder: Path, file: Path, page: Page) -> None:
        self._folder, self._file, self._page = folder, file, page
        self._server: subprocess.Popen[str] | None = None
        recording = open_recording(file)
        truth = recording.cameras[CAMERA].truth
        assert truth is not None
        self._truth: PixelTruth = truth
        times = np.arange(0, recording.duration_us, DEFAULT_STEP_US)
        self._times = times[truth.at(times).visible]
        self._size = recording.cameras[CAMERA].sensor
        recording.close()
        self.clicked = self.before_kill = self.lost = 0
        self.seconds = 0.0

    def work(self, count: int) -> None:
        """Label so many centres, with a kill in the middle."""
        self._open()
        self._label_until(count // 2)
        self.before_kill = self._count()
        assert self._server is not None
        self._server.kill()
        self._forget_server()
        self._open()
        self.lost = max(0, self.before_kill - self._count_once_read(self.before_kill))
        self._label_until(count)

    def score(self) -> int:
        """Score the detector against the labels; how many labels it was scored against."""
        self._press("Score the detector")
        self._page.wait_for_function(f"{SCORED_JS} > 0", timeout=120_000)
        return int(self._page.evaluate(SCORED_JS))

    def leave(self) -> None:
        """End the server."""
        if self._server is not None:
            self._server.terminate()
            self._forget_server()

    def _forget_server(self) -> None:
        assert self._server is not None and self._server.stdout is not None
        self._server.wait(timeout=300)
        self._server.stdout.close()
        self._server = None

    def _open(self) -> None:
        """Start the server, go to Label mode and to the first unchecked time, and have the detector propose."""
        options = ["--data", str(self._folder), "--port", "0"]
        command = [sys.executable, "-m", "app.cli", "serve", str(self._file), *options]
        self._server = subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8")
        assert self._server.stdout is not None
        line = next(line for line in self._server.stdout if "http://" in line)
        address = re.search(r"http://\S+", line)
        assert address is not None
        self._page.goto(f"{address[0]}/?fixedDpr=1")
        self._page.add_style_tag(content="[class*=mantine-Notification] { pointer-events: none !important; }")
        while self._count() < 0:  # a press before the recording is open is for nothing
            self._page.get_by_role("button", name=re.compile("^(● )?Label$")).first.click()
            self._page.wait_for_timeout(1000)
        self._page.wait_for_timeout(1500)
        before = int(self._times[0]) - DEFAULT_STEP_US
        self._page.get_by_label("Time", exact=True).fill(str(before))
        self._page.get_by_label("Time", exact=True).press("Enter")
        label = self._page.locator("label").filter(has_text=re.compile("^Annotator$"))
        name = label.locator("xpath=ancestor::*[.//input][1]").locator("input").last
        self._page.wait_for_timeout(HAND_MS)
        name.fill(ANNOTATOR)
        name.press("Enter")  # gives the keyboard back
        while self._time() <= before:  # a press before the labels of that name are there is for nothing
            self._key("u")
            self._page.wait_for_timeout(1000)
        self._key("i")
        self._page.get_by_text(re.compile(r"^[1-9]\d* proposals$")).wait_for(timeout=300_000)

    def _label_until(self, count: int) -> None:
        begun_s, tried_us, passed = time.perf_counter(), -1, 0
        while (labels := self._count()) < count:
            t_us = self._time()
            proposed = self._page.evaluate(f"{LINES_JS}.includes('proposed: space accepts')")
            by_hand = not proposed or labels % CLICK_EVERY == CLICK_EVERY - 1
            truth = self._truth.at(t_us)
            if not truth.visible[0]:
                self._key("x")  # no ball
            elif by_hand:
                self._page.mouse.click(*self._screen(float(truth.u_px[0]), float(truth.v_px[0])))
                self.clicked += t_us != tried_us  # a second try at the same time is no other decision
            else:
                self._key("Space")
            try:
                self._page.wait_for_function(f"{COUNT_JS} > {labels}", timeout=PATIENCE_MS, polling=15)
            except Exception as error:  # the picture was not there yet: what is not seen is not judged
                if "Timeout" not in type(error).__name__:
                    raise
                if self._time() == t_us == tried_us:
                    self._key("u")  # what cannot be judged by now either is passed over
                    passed += 1
                    if passed == MAX_PASSED_OVER:
                        said = self._page.evaluate("document.body.innerText")
                        raise RuntimeError(
                            f"{labels} labels at {t_us} us, and no more comes; the page says: {said}"
                        ) from error
                tried_us = t_us
                continue
            passed = 0
            if by_hand:
                self._key("u")
                self._page.wait_for_function(f"({TIME_JS}) != {t_us}", timeout=1e3 * READ_WITHIN_S, polling=15)
        self.seconds += time.perf_counter() - begun_s

    def _count(self) -> int:
        return int(self._page.evaluate(COUNT_JS))

    def _count_once_read(self, least: int) -> int:
        """Labels as the screen says when it has read them: what is lost stays so."""
        deadline_s = time.monotonic() + READ_WITHIN_S
        while (count := self._count()) < least and time.monotonic() < deadline_s:
            self._page.wait_for_timeout(200)
        return count

    def _time(self) -> int:
        return int(self._page.evaluate(TIME_JS))

    def _key(self, key: str) -> None:
        self._page.keyboard.press(key)

    def _press(self, name: str) -> None:
        self._page.get_by_role("button", name=name, exact=True).first.click()

    def _screen(self, x_px: float, y_px: float) -> tuple[float, float]:
        """CSS pixels of a sensor point, with the whole sensor in the large picture."""
        box = self._page.locator("canvas").first.bounding_box()
        assert box is not None
        ratio = self._size.height_px / self._size.width_px
        aspect, share = box["width"] / box["height"], free_share(WINDOW[1], None)
        # Below or beside it stand the whole picture and the other camera.
        free_aspect = round(20 * aspect / (1 - share)) / 20
        sides = choose_side_layout(2, ratio, MAIN_WIDTH_PX * ratio + HEIGHT_PX + 2 * GAP_PX, free_aspect)
        main, side = round(MAIN_WIDTH_PX * ratio) + GAP_PX + HEIGHT_PX, round(sides.width_px * ratio)
        if sides.beside:
            sheet = MAIN_WIDTH_PX + GAP_PX + sides.width_px, max(main, 2 * side + GAP_PX)
        else:
            sheet = MAIN_WIDTH_PX, main + GAP_PX + side
        visible, middle = framing(*sheet, aspect, share)
        scale, drawn = box["height"] / visible, MAIN_WIDTH_PX / self._size.width_px
        x, y = (x_px + 0.5) * drawn - sheet[0] / 2, (y_px + 0.5) * drawn - middle
        return box["x"] + box["width"] / 2 + x * scale, box["y"] + box["height"] / 2 + y * scale


def _result(folder: Path, file: Path, user: _User, scored: int) -> UserResult:
    recording = open_recording(file)
    stream = recording.cameras[CAMERA]
    store = LabelStore.read(folder / "labels", Layer(recording.uuid, CAMERA, ANNOTATOR))
    balls = tuple(label for label in store.all() if label.state.seen)
    labels = LabelSet(recording.uuid, CAMERA, ANNOTATOR, stream.sensor, balls)
    truth = user._truth.at([label.t_us for label in balls])
    errors = [
        float(np.hypot((label.x_px or 0) - truth.u_px[k], (label.y_px or 0) - truth.v_px[k]))
        for k, label in enumerate(balls)
    ]
    recording.close()
    checks = check_exports(labels, folder / "exports")
    return UserResult(
        labels=len(store.all()),
        accepted=len(store.all()) - user.clicked,
        clicked=user.clicked,
        decisions_per_minute=60 * len(store.all()) / user.seconds,
        before_kill=user.before_kill,
        lost=user.lost,
        median_error_px=float(np.nanmedian(errors)),
        formats=checks_text(checks),
        formats_failed=sum(check.fails(len(balls)) for check in checks),
        scored_labels=scored,
    )
