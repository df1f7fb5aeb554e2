"""A whole flight at once, in both cameras: what is agreed becomes labels, what is doubted is left to be judged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.modes.label.commands.step import LabelEdit, LabelStep, Note
from app.modes.label.label_changes import ShownPicture, accepted, proposed_at
from app.modes.label.label_writer import Act
from app.modes.label.labelling import Labelling
from app.modes.label.plan import CameraWork
from labels.assist import Proposals, WholeFlight
from labels.assist.whole_flight import Doubt
from labels.model import Label
from labels.store import LabelStore


@dataclass(frozen=True, slots=True, eq=False)
class TakeFlight:
    """Label every time of a flight at which the proposals agree with it: one step of undo in each camera.

    The cursor goes to the first doubted proposal of the camera that is labelled, or behind the flight.
    """

    found: WholeFlight

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        found, here, there = self.found, labelling.here, labelling.there
        if there is None or labelling.view.blind:
            return LabelStep(labelling)
        picture = replace(labelling.judged_picture(wall_s), time_spent_ms=0)
        own, other = (
            _labels(labelling, work, agreed, doubted, picture)
            for work, agreed, doubted in zip((here, there), found.agreed, found.doubted, strict=True)
        )
        doubted_us = self.doubted_us(labelling)
        go_us = doubted_us[0] if doubted_us else labelling.grid.moved(found.end_us, +1)
        count, elsewhere = len(own) + len(other), len(found.doubted[1])
        text = f"{count} labels in both cameras; Z takes back those of this camera."
        if doubted_us or elsewhere:
            text += f" Doubted: {len(doubted_us)} here, {elsewhere} in the other camera. K leads through them."
        return LabelStep(
            labelling.at(go_us, wall_s),
            LabelEdit(_put(own)),
            Note("Flight accepted", text, "green"),
            LabelEdit(_put(other)),
        )

    def doubted_us(self, labelling: Labelling) -> tuple[int, ...]:
        """Times to be labelled at which the proposal is off the flight, and nobody has said anything."""
        here, times = labelling.here, labelling.grid.times()
        times = times[(times >= self.found.start_us) & (times <= self.found.end_us)]
        off = {doubt.t_us for doubt in self.found.doubted[0]}
        return tuple(t_us for t_us in times.tolist() if t_us in off and here.draft(t_us) is not None)

    def reason(self, t_us: int) -> str:
        """Why a time is doubted."""
        off_px = next((doubt.off_px for doubt in self.found.doubted[0] if doubt.t_us == t_us), None)
        return "" if off_px is None else f"{off_px:.1f} px off the flight"


def _labels(
    labelling: Labelling, work: CameraWork, agreed: Proposals, doubted: tuple[Doubt, ...], picture: ShownPicture
) -> tuple[Label, ...]:
    """Of the times to be labelled; not where a doubted proposal is next, which nothing must bridge."""
    times = labelling.grid.times()
    if not len(agreed):
        return ()
    times = times[(times >= agreed.t_us[0]) & (times <= agreed.t_us[-1])]
    doubted_us = np.array([doubt.t_us for doubt in doubted], np.int64)
    times = times[(np.abs(times[:, None] - doubted_us) >= agreed.window_us).all(axis=1)]
    known, rejected = work.labels, work.rejected
    open_us = (t_us for t_us in times.tolist() if t_us not in known and (t_us, agreed.detector) not in rejected)
    drafts = (draft for t_us in open_us if (draft := proposed_at(agreed, t_us)) is not None)
    return tuple(accepted(draft, replace(picture, t_us=draft.t_us)) for draft in drafts)


def _put(labels: tuple[Label, ...]) -> Act:
    def act(store: LabelStore) -> tuple[int, ...]:
        new = tuple(label for label in labels if store.at(label.t_us) is None)
        if new:
            store.edit(put=new)
        return tuple(label.t_us for label in new)

    return act
