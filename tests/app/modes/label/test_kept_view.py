"""What a reload keeps of Label, without a browser: the link of the page before, and Label after it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from app.client_session.view_link import commands_of, link_of, values_of
from app.modes.label.kept_view import KeptView
from app.modes.label.status import proposals_html
from app.modes.label.suggestions import add_proposals
from app.state.client_state import ClientState, Configs, History, LabelChoices, Playhead
from app.state.commands import Command
from core.detection import DetectorConfig
from labels.assist import Proposals
from tests.app.modes.label.test_conflicts import MINE, THEIRS, Desk, fill

CONFIGS = History(Configs(DetectorConfig(), DetectorConfig()))
ONE = Proposals(*(np.array([column]) for column in (2000, 50.0, 40.0, 6.0, [0.1, 0.0, 0.1])), 2000, "made up")  # type: ignore[misc]


class Page:
    """The page of an annotator, from its link on."""

    def __init__(self, desk: Desk, link: str = "") -> None:
        self.desk = desk
        self.state = ClientState("demo", ("left", "right"), "left", Playhead(600_000), CONFIGS)
        self._inbox: list[Command] = list(commands_of(values_of(link), self.state))
        self.kept = KeptView(self._inbox.append)

    def turn(self) -> None:
        """A turn of the session's loop."""
        while self._inbox:
            self.state = self._inbox.pop(0).apply(self.state, 0.0)
        self.kept.follow(self.state, self.desk.editor, self.desk.comparer)

    def link(self) -> str:
        """The link in the address, once all that was chosen has come there."""
        self.turn()
        self.turn()
        return link_of(self.state, 0)

    @property
    def proposals(self) -> str:
        now = self.desk.work
        return proposals_html(now.here.proposals, None, held=False, lost=self.kept.lacks_proposals)


def test_a_reload_keeps_zoom_and_whom_is_compared_and_says_that_proposals_are_gone(
    tmp_path: Path, serve_recording: Path
) -> None:
    fill(tmp_path / "labels", serve_recording, "anna", *MINE)
    fill(tmp_path / "labels", serve_recording, "bea", *THEIRS)
    before = Desk(tmp_path, serve_recording)
    page = Page(before)
    assert "label_zoom" not in page.link() and "not kept" not in page.proposals
    before.choose("bea")
    before.editor.change_view({"zoom": 10.0})
    add_proposals(before.editor, {"left": ONE})
    link = page.link()
    assert page.state.label == LabelChoices(10.0, "bea", True) and "not kept" not in page.proposals
    before.close()

    after = Desk(tmp_path, serve_recording)
    page = Page(after, link)
    page.turn()
    assert after.work.view.zoom == 10.0
    after.wait(lambda: after.counts == (0, 4))
    assert "Proposals are not kept over a reload: I runs the detector again" in page.proposals
    assert page.link() == link, "what is not offered yet, or is gone, stays in the address for the next reload"
    after.editor.change_view({"zoom": 5.0})
    after.comparer.choose("nobody")
    add_proposals(after.editor, {"right": replace(ONE)})
    page.turn()
    assert "not kept" not in page.proposals
    page.link()
    assert page.state.label == LabelChoices(5.0, "", True)
    after.close()
