"""What of Label's view is in the address, so that a reload keeps it: zoom, whom the labels are compared with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from app.modes.label.comparer import LabelComparer
from app.modes.label.editor import LabelEditor
from app.modes.label.labelling import ZOOMS
from app.state.client_state import ClientState, LabelChoices
from app.state.commands import Command

LONGEST_TITLE: Final = 200


@dataclass(frozen=True, slots=True)
class KeepLabelChoices:
    """Take over what Label shows, or what a link says that it shows."""

    zoom: float | None = None
    """None keeps it, as it does below."""
    compared: str | None = None
    proposed: bool | None = None

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        label = state.label
        if self.zoom in ZOOMS:
            label = replace(label, zoom=self.zoom)
        if self.compared is not None and len(self.compared) <= LONGEST_TITLE:
            label = replace(label, compared=self.compared)
        if self.proposed is not None:
            label = replace(label, proposed=self.proposed)
        return replace(state, label=label)


class KeptView:
    """Keeps a browser's state and its Label the same. Called by the loop."""

    def __init__(self, send: Callable[[Command], None]) -> None:
        self._send = send
        self._seen = self._sent = LabelChoices()
        self.lacks_proposals = False
        """Whether there were proposals before the page was loaded again."""

    def forget(self) -> None:
        """Another recording was opened."""
        self.lacks_proposals = False

    def follow(self, state: ClientState, editor: LabelEditor, comparer: LabelComparer) -> None:
        """Show what a link says, and send on what a person has chosen since."""
        if state.label != self._seen:
            self._seen = state.label
            if state.label != self._sent:  # else it is what was chosen here
                self._sent = state.label
                editor.change_view({"zoom": state.label.zoom})
                comparer.choose_when_offered(state.label.compared)
                self.lacks_proposals = state.label.proposed
        now = editor.labelling
        proposed = any(work.proposals is not None for work in now.works.values())
        self.lacks_proposals &= not proposed
        chosen = LabelChoices(now.view.zoom, comparer.wanted, proposed or self.lacks_proposals)
        if chosen != self._sent:
            self._sent = chosen
            self._send(KeepLabelChoices(chosen.zoom, chosen.compared, chosen.proposed))
