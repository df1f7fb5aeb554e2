"""From one mode to the next, in a real browser. Screenshots are kept under test-artifacts/."""

import pytest

from app.modes.watch.commands import ShowSpace
from app.state.commands import SetCamera
from core.physics.episode import Case
from core.rally.history.missed_balls import MissedBallRequest, find_missed_ball
from core.rally.history.rally_history import Outcome
from core.rally.history.rally_picture import LandingSpot

pytestmark = pytest.mark.browser


def test_a_missed_ball_in_watch_is_looked_at_in_tune_and_labelled(window, lab, wait_for) -> None:
    window.session.send(ShowSpace(True))
    following = lab.services.rallies.of(window.session.recording)
    wait_for(lambda: following.followed == 1.0, "the chain to follow the recording", 90)
    following.history.add_outcome(Outcome(590_000, 10_000, 5.0, LandingSpot(0.0, 0.0, Case.MISSED)))
    window.seek(600_000)
    window.page.get_by_text("did not come back").wait_for()
    missed = find_missed_ball(MissedBallRequest(window.session.recording, following.history, 600_000))
    window.screenshot("watch-missed")
    window.press("Look at it in Tune")
    wait_for(lambda: window.state.mode == "Tune", "Tune")
    assert window.state.playhead.position_us(0.0) == missed.t_us and window.state.camera == missed.camera
    other = next(name for name in window.state.cameras if name != missed.camera)
    window.session.send(SetCamera(other))
    window.press("Watch")
    wait_for(lambda: window.state.mode == "Watch", "Watch again")
    window.seek(600_000)
    window.press("Label it")
    label = window.session._modes["Label"]
    wait_for(lambda: window.state.mode == "Label" and label._editor is not None, "Label")
    wait_for(lambda: label._editor.labelling.view.camera == missed.camera, "its camera")
    wait_for(lambda: abs(label._editor.labelling.t_us - missed.t_us) <= window.state.step_us, "its moment")
    assert window.state.recording == "serve"
