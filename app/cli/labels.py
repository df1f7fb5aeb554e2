"""`rallyscope labels import|export|score|agree|merge|shift|contacts`: exchange labels, measure with them."""

from __future__ import annotations

import argparse
import re
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from importlib.metadata import version
from math import isnan
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from app.cli.arguments import PositiveInt, flag, positional
from app.cli.labels_contacts import run_contacts
from app.cli.labels_layer import Labelled, LayerArguments, check_name, read_layer, read_whole
from app.cli.labels_merge import run_merge
from app.cli.labels_score import run_score
from app.cli.labels_shift import run_shift
from app.cli.progress import progress_bar
from app.modes.label.label_files import LabelFilesRequest, write_label_files
from app.modes.label.sources import LabelSource
from core.errors import CommandError, LabelError
from core.text import counted
from labels.agreement import Agreement, PositionAgreement, measure_agreement
from labels.contacts import (
    ContactAgreement,
    match_contacts,
    measure_contact_agreement,
    new_contacts,
)
from labels.formats import FORMATS, ExportOptions
from labels.formats.import_check import ImportChoices, import_context, import_labels
from labels.formats.import_report import ImportReport, describe_label, report_of
from labels.formats.picture_times import FrameTimes, read_frame_times
from labels.model import ContactLabel
from labels.store import LabelStore, Layer, find_layers

MAX_REASONS = 4
"""Number of reasons in the line that says why nothing was imported."""
MAX_TIMES = 5
"""Times of settled conflicts that a line names."""
FORMAT_HELP = "; ".join(f"{name}: {item.summary}" for name, item in FORMATS.items())


def _size(text: str) -> tuple[int, int]:
    """Width and height from a word such as 1280x720."""
    found = re.fullmatch(r"([1-9]\d{0,4})[xX×]([1-9]\d{0,4})", text.strip())
    if found is None:
        raise argparse.ArgumentTypeError(f"expected a width and a height such as 1280x720, got {text!r}")
    return int(found[1]), int(found[2])


PictureSize = Annotated[tuple[int, int], _size]


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelImportArguments:
    """Take labels from files of another tool."""

    source: Path = positional("a file, or a folder of files", "SRC")
    layer: LayerArguments
    format: str = flag(FORMAT_HELP, "|".join(FORMATS), choices=FORMATS)
    frame_times: Path | None = flag(
        "table with the time of each picture in a column t_us, t_ms or t_s; a column frame or name says which picture, "
        "else the first row is picture 0",
        "CSV",
    )
    ball_class: str | None = flag("name or number of the ball's class, if it is not called ball", "NAME|N", "ball")
    scale_pictures: bool = flag("scale labels to the sensor, where all pictures have one other size")
    picture_size: PictureSize | None = flag(
        "size of the pictures, where the files do not state it (tracknet, a track as csv)", "WxH"
    )
    empty_pictures: Literal["no-ball", "unchecked"] = flag(
        "listed pictures without annotation are no-ball (somebody looked and saw none) or unchecked (nobody looked)",
        default="unchecked",
    )
    replace: bool = flag("replace labels of this annotator at the same times")
    check: bool = flag("show what would be imported and what would be rejected; write nothing")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelExportArguments:
    """Write labels for another tool."""

    layer: LayerArguments
    format: str = flag(FORMAT_HELP, "|".join(FORMATS), choices=FORMATS)
    out: Path = flag("a folder; for hdf5 a file", "DIR")
    pictures: bool = flag("draw the events of each label as a PNG beside it")
    window_us: PositiveInt = flag("how much of the events --pictures draws, in us", "N", 2000)
    stride_us: PositiveInt | None = flag("write a clip with a picture every N us from the start, for tracknet", "N")
    unchecked: Literal["refuse", "drop"] = flag("tracknet: if pictures of the clip have no label", default="refuse")
    decimals: bool = flag("voc, tracknet: do not round to whole pixels")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelAgreeArguments:
    """Compare two annotators, or one with their own second looks."""

    layer: LayerArguments
    other: str | None = flag("the other annotator", "NAME", "second looks of --annotator", name="with")


def run_import(arguments: LabelImportArguments) -> None:
    """Import as one step, and say what was rejected."""
    layer = arguments.layer
    with layer.open() as (recording, stream):
        if not arguments.source.exists():
            raise CommandError("no such file or folder", where=arguments.source)
        annotator = layer.annotator or "imported"
        check_name(layer.folder, recording, annotator, "--annotator")
        choices = ImportChoices(
            times=_frame_times(arguments.frame_times, stream),
            ball_class=arguments.ball_class,
            scale_pictures=arguments.scale_pictures,
            picture_size=arguments.picture_size,
            empty_is_no_ball=arguments.empty_pictures == "no-ball",
        )
        context = import_context(recording, stream.name, stream.sensor, arguments.format, choices)
        found = import_labels(arguments.format, arguments.source, context)
        taken = len(found.labels) + len(found.contacts)
        if not taken and not found.rejections:
            expected = f"labels of {FORMATS[arguments.format].summary}"
            got = f"none in {counted(found.files, 'file')}"
            raise LabelError("nothing to import", expected=expected, got=got, where=arguments.source)
        rejections = [str(rejection) for rejection in found.rejections]
        report = report_of(found)
        if not taken and rejections:
            others = "; ".join(f"{item.count} x {item.reason}" for item in report.rejected[:MAX_REASONS])
            which = f" ({others})" if len(report.rejected) > 1 else ""
            raise LabelError(f"nothing could be imported, {len(rejections)} rejected{which}", got=rejections[0])
        if arguments.check:
            known, known_contacts = _stored(layer.folder, recording.uuid, stream.name, annotator)
            new = [label for label in found.labels if arguments.replace or label.t_us not in known]
            contacts = new_contacts(found.contacts, known_contacts, replace=arguments.replace)
        else:
            tool = f"rallyscope {version('rallyscope')}"
            with LabelStore.open(layer.folder, recording.uuid, stream.name, annotator, tool=tool) as store:
                new = [label for label in found.labels if arguments.replace or store.at(label.t_us) is None]
                known = store.contacts()
                contacts = new_contacts(found.contacts, known, replace=arguments.replace)
                replaced = {known[row].t_us for _, row in match_contacts(contacts, known)}
                gone = replaced - {contact.t_us for contact in contacts}
                # one step: one undo takes the whole import back
                store.edit(put=new, put_contacts=contacts, delete_contacts=gone)
    done = "would be imported" if arguments.check else "imported"
    there, labels = len(found.labels) - len(new), counted(len(new), "label")
    lines = [f"{labels} {done} for {annotator!r}, {there} were there already, {len(rejections)} rejected"]
    if found.contacts:
        all_contacts = counted(len(found.contacts), "contact")
        lines.append(f"{len(contacts)} of {all_contacts} {done}; the others were there already")
    layer.tell(
        {
            "annotator": annotator,
            "imported": len(new),
            "already_there": there,
            "contacts": len(contacts),
            "rejected": rejections,
            **_report_json(report),
        },
        [*lines, *_report_lines(report), *(["Nothing was written."] if arguments.check else [])],
    )


def _stored(folder: Path, uuid: str, camera: str, annotator: str) -> tuple[set[int], tuple[ContactLabel, ...]]:
    """Times of an annotator's labels of a camera, and the contacts; no store is made where there is none."""
    wanted = Layer(uuid, camera, annotator, False)
    if wanted not in find_layers(folder, uuid):
        return set(), ()
    with LabelStore.read(folder, wanted) as store:
        return set(store.labels().t_us.tolist()), store.contacts()


def _frame_times(path: Path | None, stream: Labelled) -> FrameTimes:
    """Times of the frames: those of a table, without one those of the camera's own pictures, if it takes any."""
    if path is not None:
        return read_frame_times(path)
    return FrameTimes(stream.frames_us if isinstance(stream, LabelSource) else None)


def _report_json(report: ImportReport) -> dict[str, object]:
    return {
        "files": report.files,
        "taken": report.taken,
        "states": report.states,
        "first_us": report.first_us,
        "last_us": report.last_us,
        "rejected_by_reason": [asdict(item) for item in report.rejected],
        "examples": [
            {"t_us": one.t_us, "state": str(one.state), "x_px": one.x_px, "y_px": one.y_px, "r_px": one.r_px}
            for one in report.examples
        ],
        "notes": list(report.notes),
    }


def _report_lines(report: ImportReport) -> list[str]:
    """What was rejected, with examples; what was taken, with examples; and the table of it all."""
    lines = [example for item in report.rejected for example in item.examples]
    lines += [f"for example {describe_label(label)}" for label in report.examples]
    lines += list(report.notes)
    if report.first_us is not None:
        states = ", ".join(f"{count:,} {state}" for state, count in report.states.items())
        lines.append(f"{states}; from {report.first_us:,} us to {report.last_us:,} us of the recording")
    width = max(len(number) for _, number in report.rows)
    return [*lines, *(f"{number:>{width}}  {what}" for what, number in report.rows)]


def run_export(arguments: LabelExportArguments) -> None:
    """Write the labels, and pictures of them, and say what the format could not hold."""
    out, layer = arguments.out, arguments.layer
    with layer.open() as (recording, stream):
        source = stream if isinstance(stream, LabelSource) else LabelSource(stream.name, stream.sensor, stream)
        store = read_layer(layer, recording, stream)
        frames_us = tuple(range(0, recording.duration_us, arguments.stride_us)) if arguments.stride_us else None
        request = LabelFilesRequest(
            format=arguments.format,
            recording_uuid=recording.uuid,
            annotator=store.layer.annotator,
            source=source,
            labels=store.all(),
            contacts=store.contacts(),
            frames_us=frames_us,
            pictures=arguments.pictures,
            window_us=arguments.window_us,
            options=ExportOptions(whole_pixels=not arguments.decimals, drop_unchecked=arguments.unchecked == "drop"),
        )
        with progress_bar("Drawing") if arguments.pictures else nullcontext(lambda share: None) as progress:
            made = write_label_files(request, out, progress)
    counts = {
        "labels": made.labels,
        "contacts": made.contacts,
        "files": len(made.files),
        "pictures": len(made.pictures),
    }
    what = counted(made.labels, "label") + (f" and {counted(made.contacts, 'contact')}" if made.contacts else "")
    lines = [f"{what} in {counted(counts['files'], 'file')}, {counted(counts['pictures'], 'picture')}: {out}"]
    lines += [f"not in this format: {loss}" for loss in made.losses]
    if made.earlier:
        there = counted(len(made.earlier), "file")
        lines.append(f"{there} of an earlier export still there, and read with these: {made.earlier[0]}, ...")
    layer.tell({**counts, "out": str(out), "losses": list(made.losses), "earlier": list(map(str, made.earlier))}, lines)


def run_agree(arguments: LabelAgreeArguments) -> None:
    """Compare what both said of the same instants before they settled conflicts."""
    with arguments.layer.open() as (recording, stream):
        first = read_layer(arguments.layer, recording, stream)
    mine = first.layer.annotator
    name, blind = arguments.other or mine, arguments.other is None
    layer = Layer(first.layer.recording_uuid, first.layer.camera, name, blind)
    # As they were before anybody looked at the other's: what was settled agrees by itself.
    second = read_whole(arguments.layer.folder, layer)
    mine_first, theirs_first = first.independent(), second.independent()
    contacts = measure_contact_agreement(first.contacts(), second.contacts())
    found = measure_agreement(mine_first.labels, theirs_first.labels)
    settled_us = np.union1d(mine_first.settled_us, theirs_first.settled_us)
    copied = len(mine_first.copied_us) + len(theirs_first.copied_us)
    lost = sum(int((~np.isin(one.settled_us, one.labels.t_us)).sum()) for one in (mine_first, theirs_first))
    counts = (
        f"{mine!r} and {'blind repeats' if blind else repr(name)}: {found.common} common, "
        f"{found.only_first} and {found.only_second} of one only"
    )
    notes = []
    if len(settled_us):
        times = ", ".join(f"{t_us:,}" for t_us in settled_us[:MAX_TIMES].tolist())
        more = ", ..." if len(settled_us) > MAX_TIMES else ""
        where = counted(len(settled_us), "time")
        notes.append(f"conflicts were settled at {where}: compared as before that ({times}{more} us)")
    if lost:
        notes.append(f"{counted(lost, 'label')} left out: what stood there before conflicts were settled is not stored")
    if copied:
        notes.append(f"{copied} labels were taken over from another annotator: their agreement says nothing")
    as_json = {"first": mine, "second": name, "blind": blind, "left_out": lost, "copied": copied}
    as_json |= {"settled_us": settled_us.tolist(), **asdict(found)}
    if contacts.common + contacts.only_first + contacts.only_second:
        as_json["contacts"] = asdict(contacts)
    arguments.layer.tell(as_json, [counts, *notes, *_agreement_lines(found, lost), *_contact_lines(contacts)])


def _contact_lines(found: ContactAgreement) -> list[str]:
    """Nothing where neither has any contact."""
    if not found.common + found.only_first + found.only_second:
        return []
    line = f"contacts: {found.common} common, {found.only_first} and {found.only_second} of one only"
    if not found.common:
        return [line]
    by_kind = (
        f"  {kind} ({time.pairs}): median {time.median_us / 1000:.2f} ms, p95 {time.p95_us / 1000:.2f}"
        for kind, time in found.by_kind.items()
    )
    return [f"{line}; {found.same_kind} of {found.common} of the same kind", *by_kind]


def _agreement_lines(found: Agreement, lost: int) -> list[str]:
    """In words, and only what can be said: of nothing there is no median, and without the conflicts no share.

    Positions made by hand and positions snapped to the events are never one figure: two snapped clicks are one circle.
    """
    if not found.common:
        return ["no common labels: nothing can be compared"]
    kappa = "kappa not defined: both used one state only" if isnan(found.kappa) else f"kappa {found.kappa:.3f}"
    states = f"states: {found.same_state} of {found.common} the same, {kappa}"
    if lost:
        states = (
            f"states: agreement cannot be told without the {counted(lost, 'conflict')} left out; of the other "
            f"{counted(found.common, 'time')} {found.same_state} the same"
        )
    if not found.both_seen:
        return [states, "positions: no common label in which both saw the ball"]
    return [
        states,
        f"positions ({found.both_seen}), by how they were made; bias {found.bias_x_px:+.2f} {found.bias_y_px:+.2f} px"
        + (f"; {counted(lost, 'conflict')} left out and missing here" if lost else ""),
        *(_source_line(name, group) for name, group in found.by_source.items() if group.pairs or name == "by_hand"),
    ]


def _source_line(name: str, group: PositionAgreement) -> str:
    """One group of pairs, and what its figures do not tell."""
    title = f"  {name.replace('_', ' ')} ({group.pairs})"
    if not group.pairs:
        return f"{title}: no pair; how well two people agree cannot be told from these labels"
    same = f"; {group.same_position} are one position taken twice" if group.same_position else ""
    return (
        f"{title}: median {group.median_px:.2f} px, p95 {group.p95_px:.2f}, sigma of one {group.sigma_px:.2f} px{same}"
    )


ACTS = {
    "import": run_import,
    "export": run_export,
    "score": run_score,
    "agree": run_agree,
    "merge": run_merge,
    "shift": run_shift,
    "contacts": run_contacts,
}
