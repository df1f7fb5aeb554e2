"""Train, in a real browser: a policy is trained, watched, stopped, killed, resumed. Screenshots: test-artifacts/."""

import os
import re
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from app.modes.train import run_panel
from app.modes.train.mode import TrainMode
from app.scene.prediction import CASE_RGB
from app.server import App
from app.shared.trainer import RunState, Trainer
from core.physics.episode import Case
from tests.app.browser.window import choose_in, count_like, open_page
from tests.app.modes.train.conftest import train_here
from tests.app.modes.train.small_runs import small_run
from tests.waiting import eventually

GREEN, ORANGE, BLUE_TABLE = CASE_RGB[Case.RETURNED], (255, 140, 40), (48, 122, 202)
LEFT_PX = 340
"""Width of the panel with the curves."""


@pytest.fixture
def trainer(lab: App) -> Iterator[Trainer]:
    trainer = lab.services.trainer
    yield trainer
    trainer.ask("stop")
    eventually(lambda: trainer.active() is None, "the training to end")


def enter(window) -> TrainMode:
    """Choose the mode."""
    window.press("Train")
    window.page.get_by_role("tab", name="Curves").wait_for()
    return window.session._modes["Train"]


def pick(window, label: str, option: str) -> None:
    """Choose from a dropdown."""
    choose_in(window.page.get_by_label(label, exact=True).first, option, exact=False)


def start(window, name: str, balls: int) -> None:
    """A training of the landing model that can be watched, from the form."""
    form = window.session._modes["Train"]._form_panel
    window.page.get_by_text("A new training").click()
    window.fill(window.field("episodes"), str(balls))
    window.fill(window.field("Name"), name)
    # The page sends what is typed a little later.
    eventually(
        lambda: (form._name.value, str(form._handles[("curriculum", "episodes")].value)) == (name, str(balls)),
        "the form",
    )
    pick(window, "Pace", "20 balls a second")
    window.press("Start")


def newest(trainer: Trainer) -> RunState:
    return trainer.runs()[0]


def phase(trainer: Trainer) -> str:
    """That of the newest run; empty while there is none, as for a moment after Start."""
    return newest(trainer).phase if trainer.runs() else ""


def shows(mode: TrainMode, name: str) -> bool:
    """Whether the curves are those of this run: until it is chosen they are of the one before it."""
    return mode._view is not None and mode._view.run is not None and mode._view.run.name == name


@pytest.mark.gate
def test_train_now_learns_to_place_balls_before_ones_eyes(window, trainer: Trainer) -> None:
    mode = enter(window)
    eventually(window.page.get_by_text("Nothing trained yet").is_visible, "the invitation")
    window.press("Train now")
    eventually(lambda: mode.replay is not None, "the first ball to fly")
    assert newest(trainer).episodes_per_s == 2.5
    first = mode.replay
    eventually(lambda: mode.replay is not first, "the next ball")
    pick(window, "Pace", "as fast as possible")
    eventually(lambda: phase(trainer) == "finished", "the training to finish")
    window.page.get_by_text("ball 100 of 100").wait_for()

    def is_drawn(canvas: np.ndarray) -> bool:
        """The table with its landing spots, and the curves."""
        scene, curves = canvas[:, LEFT_PX:], canvas[:, :LEFT_PX]
        on_table = count_like(scene, GREEN, 80) > 200 and count_like(scene, BLUE_TABLE, 40) > 5000
        return on_table and count_like(curves, ORANGE) > 100

    window.wait_for_pixels("train", is_drawn)
    eventually(lambda: mode.details is not None and mode.details.returned == 100, "all balls to be read")
    assert mode.details is not None
    assert mode.details.error_mm < 150 and mode.details.evaluations[-1]["error_mm"] < 40
    window.page.get_by_text("Learned: it returns 100 % of the balls at 5 m/s").wait_for()
    window.page.get_by_role("tab", name="Landings").click()
    window.page.get_by_text("own half").first.wait_for()
    window.screenshot("train-landings")
    window.page.get_by_role("tab", name="Map").click()
    window.page.get_by_text("Inside the box").first.wait_for()
    window.screenshot("train-map")


def test_one_button_makes_a_film_of_the_training(
    window, lab, workspace, trainer: Trainer, tmp_path, monkeypatch
) -> None:
    make = run_panel.export_training_film

    def once_cancelled(task):  # a fast machine is done before anybody could cancel
        eventually(task.cancelled, "the film to be cancelled")
        return make(task)

    monkeypatch.setattr(run_panel, "export_training_film", once_cancelled)
    mode = enter(window)
    start(window, "filmed", 30)
    eventually(lambda: shows(mode, "filmed"), "its curves, not those of the run before it")
    eventually(lambda: phase(trainer) == "finished", "the training to finish")
    window.wait_until_still()  # what ended has other buttons than what ran
    window.press("Film of this training")
    window.page.get_by_role("button", name="Cancel the film").wait_for()
    window.press("Cancel the film")
    window.page.get_by_text("cancelled").first.wait_for()
    assert not (workspace.exports / "filmed-film-1.mp4").exists()
    eventually(lambda: not lab.services.exporter._job.running, "the cancelled film to be gone")
    monkeypatch.undo()
    window.press("Film of this training")
    window.page.get_by_role("button", name="Download the film").wait_for()
    window.screenshot("train-film")
    with window.page.expect_download() as waiting:
        window.press("Download the film")
    waiting.value.save_as(tmp_path / "film.mp4")
    (made,) = lab.services.exporter.files()
    assert (tmp_path / "film.mp4").read_bytes() == (workspace.exports / made.name).read_bytes()


AXES = """() => Object.values(window.__viserTestpoints.uplots).map(({ chart }) =>
  chart.axes.map((axis) => Boolean(axis._show && axis._splits?.length)))"""
"""Of each chart, whether each axis is drawn."""
SHOWN_SEEDS = """() => Object.values(window.__viserTestpoints.uplots)[0].chart.series
  .filter((one) => one.show && /^seed /.test(one.label)).map((one) => one.label)"""


def test_charts_of_a_training_that_ended_elsewhere_have_axes_and_every_seed_under_the_mouse(
    window, workspace, trainer: Trainer
) -> None:
    page, mode = window.page, enter(window)
    page.get_by_role("tab", name="Log").click()
    window.press("Watch")
    train_here(workspace.run_path("three"), small_run(speeds_mps=(4.0, 5.0), episodes=(30, 30), seeds=3))
    window.press("Train")
    eventually(lambda: shows(mode, "three") and mode.details.episodes_done == 60, "the run that ended elsewhere")
    page.get_by_role("tab", name="Curves").click()
    page.get_by_text("stage 2, 5 m/s").wait_for()
    eventually(lambda: page.evaluate(AXES) == [[True] * 3] * 4, "the axes of all charts")
    assert page.evaluate(SHOWN_SEEDS) == []
    over = page.locator(".u-over").first.bounding_box()
    tip = page.locator("#rallyscope-chart-tip")
    for share in np.arange(0.05, 1.0, 0.1):  # on its way down the mouse comes to a line
        page.mouse.move(over["x"] + over["width"] * 0.6, over["y"] + over["height"] * share)
        if tip.is_visible():
            break
    assert re.fullmatch(r"seed [01]: \d+(\.\d+)? at ball \d+", tip.inner_text())
    assert page.evaluate(SHOWN_SEEDS) == ["seed 0", "seed 1"]
    window.screenshot("train-seeds")
    page.mouse.move(over["x"] + over["width"] + 300, over["y"])
    eventually(lambda: page.evaluate(SHOWN_SEEDS) == [], "the lines to go with the mouse")
    page.get_by_role("tab", name="Map").click()
    page.get_by_text("Before the training").wait_for()
    window.screenshot("train-map-before")
    window.press("Let it play")
    page.get_by_text("current policy, no noise").wait_for()


NAME, TITLE = "stop-me", "Stop me"
BALLS = 20_000
"""More than are played before a test ends it."""


def a_form_that_makes_no_sense_is_answered_in_one_line(window, trainer: Trainer) -> None:
    count = len(trainer.runs())
    start(window, "../../nothing", 0)
    window.page.get_by_text("not a number of episodes").wait_for()
    window.fill(window.field("episodes"), "all of them")
    form = window.session._modes["Train"]._form_panel
    eventually(lambda: form._handles[("curriculum", "episodes")].value == "all of them", "the form")
    window.press("Start")
    window.page.get_by_text("not a list of numbers").wait_for()
    assert len(trainer.runs()) == count and trainer.active() is None


def a_browser_that_closes_changes_nothing_and_another_sees_the_same(window, chromium, lab, trainer: Trainer) -> None:
    page = open_page(chromium)
    other = type(window)(page, lab)
    other_mode = enter(other)
    start(other, TITLE, BALLS)
    eventually(lambda: phase(trainer) == "running", "the training to run")
    page.close()
    eventually(lambda: other.session not in lab.sessions, "the browser to be gone")
    mode = window.session._modes["Train"]
    eventually(lambda: shows(mode, NAME) and mode.details.episodes_done > 0, "the other to see it")
    done = mode.details.episodes_done
    eventually(lambda: mode.details.episodes_done > done + 20, "the training to go on")
    assert other_mode is not mode and newest(trainer).name == NAME


def a_stop_is_confirmed_and_the_run_goes_on_from_there(window, trainer: Trainer) -> None:
    window.page.get_by_role("button", name="Stop", exact=True).click()
    window.page.get_by_text(f"Stop {NAME}?").wait_for()
    window.press("No, continue")
    window.page.get_by_text(f"Stop {NAME}?").wait_for(state="hidden")
    assert newest(trainer).phase == "running"
    window.page.get_by_role("button", name="Pause").click()
    eventually(lambda: phase(trainer) == "paused", "a pause")
    window.page.get_by_role("button", name="Continue").click()
    eventually(lambda: phase(trainer) == "running", "it to go on")
    window.page.get_by_role("button", name="Stop", exact=True).click()
    window.press("Yes, stop it")
    eventually(lambda: phase(trainer) == "stopped", "the stop")
    before = newest(trainer).status
    window.press("Resume")
    eventually(lambda: phase(trainer) == "running", "it to go on")
    after = newest(trainer).status
    assert before is not None and after is not None and after.episode >= before.episode > 0


def a_killed_training_is_reported_with_its_log_and_resumed(window, trainer: Trainer) -> None:
    mode = window.session._modes["Train"]
    eventually(lambda: mode.details.evaluations, "a checkpoint")
    status = newest(trainer).status
    assert status is not None and newest(trainer).name == NAME
    os.kill(status.pid, signal.SIGKILL)
    window.page.get_by_text(f"Training {NAME} failed").wait_for()
    window.page.get_by_text("the process was killed (SIGKILL)").first.wait_for()
    window.page.get_by_role("tab", name="Log").click()
    window.page.get_by_text("ended with code -9").wait_for()
    window.screenshot("train-killed")
    window.press("Resume")
    eventually(lambda: phase(trainer) == "running", "it to go on")
    resumed = newest(trainer).status
    assert resumed is not None and resumed.episode >= 50


def test_a_training_outlives_its_browser_a_stop_and_a_kill(window, chromium, lab, trainer: Trainer) -> None:
    enter(window)
    a_form_that_makes_no_sense_is_answered_in_one_line(window, trainer)
    a_browser_that_closes_changes_nothing_and_another_sees_the_same(window, chromium, lab, trainer)
    a_stop_is_confirmed_and_the_run_goes_on_from_there(window, trainer)
    a_killed_training_is_reported_with_its_log_and_resumed(window, trainer)
