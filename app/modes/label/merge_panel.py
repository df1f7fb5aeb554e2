"""Compare and merge, in Label's panel: with whom, how much is settled, and the two labels at the cursor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app import theme
from app.formatting import html_text, note_html
from app.modes.label.comparer import LabelComparer
from app.modes.label.comparison import LabelComparison, apart_px, pair_legend, short_name
from app.modes.label.labelling import Labelling
from app.views.mosaic import css_colour
from app.widgets import Listing, when_clicked
from labels.conflicts import WITHIN_PX, how_settled
from labels.model import Label

NOBODY: Final = "nobody"
LINE: Final = "font-size:12.5px;padding:1px 12px"
HOW: Final = {
    "mine": "yours was taken",
    "theirs": "theirs was taken",
    "mean": "the mean was taken",
    "new": "a new label",
}
HINT: Final = "Another annotator, or a label store in the folder labels-of-others of the workspace"


class MergePanel:
    """Built once for one browser, folded."""

    def __init__(self, gui: viser.GuiApi, choose: Callable[[str], None], act: Callable[[str], None]) -> None:
        with gui.add_folder("Compare and merge", expand_by_default=False):
            self._whom = Listing(gui, "Compare with", choose, hint=HINT)
            self._status = gui.add_html("")
            self._take = gui.add_button_group("Take", ("Yours (J)", "Theirs (L)", "Mean"), visible=False)
            self._go = gui.add_button_group("Conflict", ("Previous", "Next"), visible=False)
            self._missing = gui.add_button("Take over", icon=viser.Icon.DOWNLOAD, visible=False)
        names = {
            "Yours (J)": "take_mine",
            "Theirs (L)": "take_theirs",
            "Mean": "take_mean",
            "Previous": "previous_conflict",
            "Next": "next_conflict",
        }
        for group in (self._take, self._go):

            @group.on_click
            async def _(event: viser.GuiEvent) -> None:
                if event.client is not None:
                    act(names[str(event.target.value)])

        when_clicked(self._missing, lambda: act("take_missing"))
        self._shown: object = None

    def show(self, comparer: LabelComparer, labelling: Labelling) -> None:
        """What is compared, at the cursor and as a whole; nothing is sent while it stays the same."""
        compared = labelling.compared_here
        offered, chosen = tuple(comparer.offered), comparer.chosen
        here = labelling.here
        shown = (offered, chosen, comparer.problem, comparer.notes, compared, here, labelling.t_us, labelling.view)
        if self._shown is not None and shown == self._shown:
            return
        self._shown = shown
        title = NOBODY if chosen is None else chosen.title
        self._whom.offer(tuple(dict.fromkeys((NOBODY, *offered, title))))
        self._whom.show(title)
        self._take.visible = self._go.visible = compared is not None
        missing = 0 if compared is None else len(compared.only_theirs_us)
        self._missing.visible = bool(missing)
        if compared is not None:
            self._missing.label = f"Take over {missing} that only {short_name(compared.theirs.annotator)} has"
        self._status.content = panel_html(labelling, comparer.problem, comparer.notes, waiting=chosen is not None)


def panel_html(labelling: Labelling, problem: str, notes: tuple[str, ...], *, waiting: bool) -> str:
    """What stands below the choice of whom to compare with."""
    if problem:
        return note_html(html_text(problem), theme.BAD)
    compared = labelling.compared_here
    if compared is None:
        return note_html("comparing", theme.MUTED) if waiting else ""
    notes_html = [note_html(html_text(note), theme.BAD) for note in notes[:3]]
    t_us = labelling.t_us
    return "".join([*notes_html, counts_html(compared), pair_html(compared, t_us, labelling.here.labels.get(t_us))])


def counts_html(compared: LabelComparison) -> str:
    """How many agree, and how far the conflicts are settled."""
    settled, left = len(compared.resolved_us), len(compared.open_us)
    name = html_text(short_name(compared.theirs.annotator))
    progress = f"<b>{settled} of {settled + left} settled</b>" if settled + left else "no conflicts"
    others = f"{compared.only_mine} only yours, {len(compared.only_theirs_us)} only {name}'s"
    return note_html(progress, theme.WARN if left else theme.GOOD) + note_html(
        f"{compared.agreed} agree (same state, within {WITHIN_PX:g} px); {others}", theme.MUTED
    )


def pair_html(compared: LabelComparison, t_us: int, mine: Label | None) -> str:
    """The two labels at a time, if they are to be seen beside each other, and how far apart they are."""
    theirs = compared.theirs_beside(t_us, mine)
    if theirs is None:
        return note_html("no conflict here", theme.MUTED)
    names = compared.mine.annotator, compared.theirs.annotator
    rows = "".join(
        f"<div style='{LINE};margin:2px 12px;border-left:6px solid {css_colour(ink, 'orange / blue')}'>"
        f"{html_text(text)}</div>"
        for text, ink in pair_legend((names[0], mine), (names[1], theirs))
    )
    apart = apart_px(mine, theirs)
    distance = "" if apart is None else f"{apart:.2f} px apart"
    how = None if mine is None else how_settled(mine, names[1], theirs)
    how_theirs = None if mine is None else how_settled(theirs, names[0], mine)
    if how is not None:
        distance += f"; settled: {HOW[how]}"
    elif how_theirs is not None:
        distance += f"; settled by {html_text(short_name(names[1]))}"
    return rows + note_html(distance.removeprefix("; "), theme.MUTED)
