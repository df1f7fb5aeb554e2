"""`rallyscope labels merge`: put the stores of several annotators together, and list what they disagree about."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final

from app.cli.arguments import flag, positional
from app.cli.tables import json_ready
from app.cli.terminal import print_lines, say
from labels.conflicts import WITHIN_PX, LabelConflict
from labels.merging import MergedStores, merge_stores

MAX_SHOWN: Final = 20
"""Conflicts printed one by one; `--json` has them all."""


def _distance(text: str) -> float:
    value = float(text)
    if not 0 <= value < float("inf"):
        raise ValueError(text)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelMergeArguments:
    """Put label stores of one recording together. Where annotators disagree, the labels are listed and left out."""

    stores: tuple[Path, ...] = positional("a labels.sqlite, or the folder of a recording's labels", "STORE")
    out: Path = flag("the new store", "FILE.sqlite")
    within_px: Annotated[float, _distance] = flag("centres farther apart are a conflict", "PX", WITHIN_PX)
    prefer: str | None = flag("whose labels to take in conflicts", "NAME", "nobody's")
    json: bool = flag("print the result as JSON")


def run_merge(arguments: LabelMergeArguments) -> None:
    """Merge, and say what was left out."""
    merged = merge_stores(arguments.stores, arguments.out, within_px=arguments.within_px, prefer=arguments.prefer)
    if arguments.json:
        say(json.dumps(json_ready({**asdict(merged), "out": str(arguments.out)})))
    else:
        print_lines(_lines(merged, arguments))


def _lines(merged: MergedStores, arguments: LabelMergeArguments) -> list[str]:
    lines = [
        f"{merged.labels} labels merged into {arguments.out}; {len(merged.conflicts)} conflicts, "
        f"{merged.left_out} labels left out; {merged.superseded} replaced by what their annotator said later"
    ]
    if merged.settled:
        lines.append(f"{merged.settled} conflicts were settled in Label: the label that settles each was taken")
    lines += [_conflict_line(conflict) for conflict in merged.conflicts[:MAX_SHOWN]]
    more = len(merged.conflicts) - MAX_SHOWN
    return [*lines, *([f"... and {more} more, see --json"] if more > 0 else []), *merged.notes]


def _conflict_line(conflict: LabelConflict) -> str:
    where = f"{conflict.camera} {conflict.t_us} us"
    states_text = "; ".join(
        f"{name}: {state}" for name, state in zip(conflict.annotators, conflict.states, strict=True)
    )
    apart = "" if conflict.distance_px is None else f"; {conflict.distance_px:.2f} px apart"
    return f"{where}: {states_text}{apart}"
