"""`rallyscope labels merge`: label stores of several annotators become one; conflicts are listed and left out."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final

from app.cli.arguments import flag, positional
from app.cli.terminal import json_ready, print_lines, say
from core.text import counted
from labels.conflicts import WITHIN_PX, LabelConflict
from labels.contacts import ContactConflict
from labels.merging import MergedStores, merge_stores

MAX_SHOWN: Final = 20
"""Conflicts printed one by one; `--json` has them all."""


def _distance(text: str) -> float:
    with suppress(ValueError):
        if 0 <= (value := float(text)) < float("inf"):
            return value
    raise argparse.ArgumentTypeError(f"expected a distance in pixels, 0 or more, got {text!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelMergeArguments:
    """Merge label stores of one recording. Labels on which annotators disagree are listed and left out."""

    stores: tuple[Path, ...] = positional("a labels.sqlite, or the folder that holds it", "STORE")
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
        f"{counted(merged.labels, 'label')} merged into {arguments.out}; {counted(len(merged.conflicts), 'conflict')}, "
        f"{counted(merged.left_out, 'label')} left out; {merged.superseded} changed or deleted later by the "
        "same annotator"
    ]
    if merged.settled:
        lines.append(f"{counted(merged.settled, 'conflict')} settled in Label: the label that settles each was taken")
    if merged.contacts or merged.contact_conflicts:
        lines.append(f"{counted(merged.contacts, 'contact')} merged; {len(merged.contact_conflicts)} in conflict")
    lines += [_contact_conflict_line(conflict) for conflict in merged.contact_conflicts[:MAX_SHOWN]]
    lines += [_conflict_line(conflict) for conflict in merged.conflicts[:MAX_SHOWN]]
    more = len(merged.conflicts) - MAX_SHOWN
    return [*lines, *([f"... and {more} more, see --json"] if more > 0 else []), *merged.notes]


def _contact_conflict_line(conflict: ContactConflict) -> str:
    each = zip(conflict.annotators, conflict.kinds, conflict.times_us, strict=True)
    return f"{conflict.camera} contact: " + "; ".join(f"{name}: {kind} at {t_us} us" for name, kind, t_us in each)


def _conflict_line(conflict: LabelConflict) -> str:
    where = f"{conflict.camera} {conflict.t_us} us"
    states_text = "; ".join(
        f"{name}: {state}" for name, state in zip(conflict.annotators, conflict.states, strict=True)
    )
    apart = "" if conflict.distance_px is None else f"; {conflict.distance_px:.2f} px apart"
    return f"{where}: {states_text}{apart}"
