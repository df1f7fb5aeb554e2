"""`rallyscope labels contacts`: bounces, hits and net touches of a recording, labelled or proposed, and their score."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Final

from app.cli.arguments import DATA, PositiveInt, flag, positional
from app.cli.detector_arguments import MethodArguments
from app.cli.labels_layer import LayerArguments, check_name, read_layers
from app.cli.progress import progress_bar
from app.formatting import share_text
from core.errors import CommandError
from core.recordings import CameraStream, Recording, open_recording
from core.text import counted
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import propose
from labels.contacts import (
    MATCH_US,
    ContactScore,
    contacts_of_truth,
    join_contacts,
    new_contacts,
    score_contacts,
)
from labels.model import ContactLabel, PositionSource
from labels.store import LabelStore

TRUTH: Final = "truth"
"""The name that stands for the recording's own ground truth."""
MAX_SHOWN: Final = 40
"""Contacts printed one by one; `--json` has them all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelContactsArguments:
    """Bounces, hits and net touches: list an annotator's, or propose them; score them against others."""

    recording: Path = positional("a recording", "REC")
    annotator: str | None = flag("whose contacts", "NAME", "what a detector in two cameras or more proposes")
    against: str | None = flag("score them against the contacts of an annotator, or the ground truth", f"{TRUTH}|NAME")
    within_us: PositiveInt = flag("contacts farther apart are not the same", "N", MATCH_US)
    save_as: str | None = flag("store what is proposed, as labels of NAME in the first camera", "NAME")
    detector: MethodArguments
    data: Path = flag("workspace", "DIR", DATA)
    json: bool = flag("print the result as JSON")


def run_contacts(arguments: LabelContactsArguments) -> None:
    """List or propose contacts, store them if asked to, and score them."""
    if arguments.annotator is not None and arguments.save_as is not None:
        raise CommandError("only proposals are stored", got=arguments.save_as, remedy="leave out --annotator")
    with closing(open_recording(arguments.recording)) as recording:
        reference = None if arguments.against is None else _contacts_of(arguments, recording, arguments.against)
        if arguments.annotator is not None:
            found = _contacts_of(arguments, recording, arguments.annotator)
        else:
            with progress_bar("Detecting") as progress:
                found = _proposed(arguments.detector, recording, progress)
        stored = 0 if arguments.save_as is None else _store(arguments, recording, found, arguments.save_as)
    scores = () if reference is None else score_contacts(found, reference, arguments.within_us)
    report: dict[str, object] = {
        "annotator": arguments.annotator,
        "contacts": [_contact_json(contact) for contact in found],
        "stored": stored,
        "against": arguments.against,
        "scores": [asdict(score) for score in scores],
    }
    lines = [f"{counted(len(found), 'contact')} of {arguments.annotator or 'the detector'}"]
    lines += [_line(contact) for contact in found[:MAX_SHOWN]]
    lines += [f"... and {len(found) - MAX_SHOWN} more, see --json"] if len(found) > MAX_SHOWN else []
    if arguments.save_as is not None:
        lines.append(f"{stored} stored for {arguments.save_as!r}")
    lines += [_score_line(score, arguments.against or "") for score in scores]
    LayerArguments(
        recording=arguments.recording, camera=None, annotator=None, data=arguments.data, json=arguments.json
    ).tell(report, lines)


def _contacts_of(arguments: LabelContactsArguments, recording: Recording, name: str) -> tuple[ContactLabel, ...]:
    """Contacts of an annotator in all cameras, each event once; or those of the ground truth."""
    if name == TRUTH:
        if recording.ball is None:
            raise CommandError("this recording has no ground truth of the ball", where=arguments.recording)
        return contacts_of_truth(recording.ball)
    stores = read_layers(arguments.data / "labels", recording, tuple(recording.cameras), name)
    contacts: tuple[ContactLabel, ...] = ()
    for store in stores:
        with store:
            contacts = join_contacts(contacts, store.contacts())
    return contacts


def _proposed(
    detector: MethodArguments, recording: Recording, progress: Callable[[float], None]
) -> tuple[ContactLabel, ...]:
    streams = [stream for stream in recording.cameras.values() if stream.calibration is not None]
    if len(streams) < 2:
        expected = "two calibrated cameras or more"
        raise CommandError("contacts are proposed from the path in space", expected=expected, got=len(streams))
    saved = detector.settings()
    parts = []
    for number, stream in enumerate(streams):

        def done(share: float, number: int = number) -> None:
            progress((number + share) / len(streams))

        end_us = recording.duration_us
        parts.append(propose(stream, 0, end_us, method=saved.method, config=saved.config, progress=done))
    return propose_contacts([_calibrated(stream) for stream in streams], parts)


def _calibrated(stream: CameraStream):
    assert stream.calibration is not None, "chosen by that"
    return stream.calibration


def _store(arguments: LabelContactsArguments, recording: Recording, found: tuple[ContactLabel, ...], name: str) -> int:
    """Store them in one step; those that are there already are left as they are."""
    camera, tool = next(iter(recording.cameras)), f"rallyscope {version('rallyscope')}"
    check_name(arguments.data / "labels", recording, name, "--save-as")
    with LabelStore.open(arguments.data / "labels", recording.uuid, camera, name, tool=tool) as store:
        # Nobody has accepted them: they come from elsewhere, as imported labels do.
        made = (
            replace(contact, provenance=replace(contact.provenance, source=PositionSource.IMPORTED))
            for contact in new_contacts(found, store.contacts())
        )
        return store.edit(put_contacts=made)


def _contact_json(contact: ContactLabel) -> dict[str, object]:
    made = contact.provenance
    return {
        "t_us": contact.t_us,
        "kind": str(contact.kind),
        "sigma_us": contact.sigma_us,
        "annotator": made.annotator,
        "detector": made.detector,
    }


def _line(contact: ContactLabel) -> str:
    sigma = "" if contact.sigma_us is None else f" +-{contact.sigma_us / 1000:.2f} ms"
    return f"{contact.t_us:>12} us  {contact.kind}{sigma}"


def _score_line(score: ContactScore, against: str) -> str:
    ratios = ", ".join(
        f"{name} {share_text(value)}" for name, value in (("precision", score.precision), ("recall", score.recall))
    )
    time = score.time
    error = f"; time error median {time.median_us / 1000:.3f} ms, p95 {time.p95_us / 1000:.3f}, "
    error += f"bias {time.bias_us / 1000:+.3f}"
    counts = f"{score.matched} of {score.reference} in {against!r} found, {score.found} in all"
    return f"{score.kind}: {ratios} ({counts}){error if score.matched else ''}"
