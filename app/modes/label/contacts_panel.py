"""Controls of bounces, hits and net touches in Label, and their list."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app.modes.label.contacts import contact_marks, contacts_html
from app.modes.label.labelling import Labelling
from app.modes.mode import ModeHost
from labels.model import ContactKind

SET: Final = {"Bounce": ContactKind.BOUNCE, "Hit": ContactKind.HIT, "Net": ContactKind.NET}
CHANGE: Final = {"Accept": "accept_contact", "Next": "next_contact", "Remove": "remove_contact"}


class ContactsPanel:
    """The folder of one browser, and its marks in the time bar. Methods are called by the loop."""

    def __init__(self, host: ModeHost, act: Callable[[str], None]) -> None:
        self._host = host
        self._shown: object = None
        self._marked: object = None
        gui = host.client.gui
        with gui.add_folder("Bounces, hits and net"):
            kinds = gui.add_button_group("Here is a", tuple(SET), hint="Shift T, O, M; one within 10 ms moves here")
            change = gui.add_button_group(
                "Contact", tuple(CHANGE), hint="Shift Enter, Shift L, Shift Delete: removes, or rejects"
            )
            self._list = gui.add_html("")

        @kinds.on_click
        async def _(event: viser.GuiEvent) -> None:
            act(str(SET[str(event.target.value)]))

        @change.on_click
        async def _(event: viser.GuiEvent) -> None:
            act(CHANGE[str(event.target.value)])

    def forget(self) -> None:
        """Another recording was opened: its time bar has no marks yet."""
        self._shown = self._marked = None

    def show(self, now: Labelling) -> None:
        """List and mark the contacts, if something has changed since the last turn."""
        rejected_us = tuple(work.no_contacts_us for work in now.works.values())
        theirs = None if now.compared_here is None else now.compared_here.theirs.contacts
        known = (now.contacts, now.proposed_contacts, now.view.repeat, rejected_us, theirs)
        if known != self._marked:
            self._marked = known
            self._host.show_contacts(contact_marks(now))
        if (*known, now.t_us) != self._shown:
            self._shown = (*known, now.t_us)
            content = contacts_html(now)
            if content != self._list.content:
                self._list.content = content
