"""What keys and buttons of Label ask for, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from app.modes.label.commands.assisted import Accept, AcceptSegment, Interpolate, Reject
from app.modes.label.commands.cursor import (
    ChangeView,
    Escape,
    GoToEnd,
    GoToUnchecked,
    OtherCamera,
    StepBy,
)
from app.modes.label.commands.hand import (
    Clear,
    CopyPrevious,
    Nudge,
    Resize,
    SetState,
    SnapLabel,
    ToggleBreak,
    UndoLabel,
)
from app.modes.label.commands.step import LabelCommand
from app.modes.label.merge.settling import GoToConflict, Settle, TakeMissing
from app.modes.label.view import BIG_NUDGE_PX, NUDGE_PX, RADIUS_STEP_PX, WINDOWS_US, ZOOMS
from labels.model import LabelState

COMMANDS: Final[Mapping[str, LabelCommand]] = {
    "accept": Accept(),
    "accept_segment": AcceptSegment(),
    "reject": Reject(),
    "next": StepBy(+1),
    "previous": StepBy(-1),
    "ten_on": StepBy(+10),
    "ten_back": StepBy(-10),
    "first": GoToEnd(last=False),
    "last": GoToEnd(last=True),
    "unchecked": GoToUnchecked(),
    "no_ball": SetState(LabelState.NO_BALL),
    "out_of_frame": SetState(LabelState.OUT_OF_FRAME),
    "visible": SetState(LabelState.VISIBLE),
    "partly": SetState(LabelState.PARTLY_OCCLUDED),
    "occluded": SetState(LabelState.OCCLUDED),
    "copy": CopyPrevious(),
    "snap": SnapLabel(),
    "interpolate": Interpolate(),
    "break": ToggleBreak(),
    "up": Nudge(0, -NUDGE_PX),
    "down": Nudge(0, NUDGE_PX),
    "left": Nudge(-NUDGE_PX, 0),
    "right": Nudge(NUDGE_PX, 0),
    "up_more": Nudge(0, -BIG_NUDGE_PX),
    "down_more": Nudge(0, BIG_NUDGE_PX),
    "left_more": Nudge(-BIG_NUDGE_PX, 0),
    "right_more": Nudge(BIG_NUDGE_PX, 0),
    "larger": Resize(RADIUS_STEP_PX),
    "smaller": Resize(-RADIUS_STEP_PX),
    "undo": UndoLabel(),
    "redo": UndoLabel(redo=True),
    "clear": Clear(),
    "escape": Escape(),
    "next_conflict": GoToConflict(+1),
    "previous_conflict": GoToConflict(-1),
    "take_mine": Settle("mine"),
    "take_theirs": Settle("theirs"),
    "take_mean": Settle("mean"),
    "take_missing": TakeMissing(),
    "camera": OtherCamera(),
    **{f"window_{row}": ChangeView({"window_us": window_us}) for row, window_us in enumerate(WINDOWS_US)},
    **{f"zoom_{row}": ChangeView({"zoom": zoom}) for row, zoom in enumerate(ZOOMS)},
}
"""By the name that `keys.KEYS` gives them."""
