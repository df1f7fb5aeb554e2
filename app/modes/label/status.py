"""What the panel says in words: whether everything is saved, how far the work is, what is known at this time."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from app import theme
from app.formatting import html_text, note_html, percent
from app.modes.label.contacts import contact_near
from app.modes.label.label_changes import ProposedLabel
from app.modes.label.label_picture import STATE_INKS
from app.modes.label.label_writer import LabelWriter
from app.modes.label.labelling import Labelling
from app.modes.label.sightings import FROM_OTHERS, CameraAgreement, draft_at
from app.pictures.palette import PaletteIndex
from core.text import counted
from labels.assist import Proposals
from labels.assist.stereo import radius_is_off
from labels.model import Label

HERE_STYLE = "height:66px;overflow-y:auto"
"""Style of the lines of one time: as high for one line as for three, or the controls below move under the mouse."""
BRAND = f"rgb{theme.BRAND_RGB}"
AMBER = "#ffb020"
FAR_PX = 2.0
"""Cameras that agree less are marked."""


@dataclass(frozen=True, slots=True)
class Checked:
    """How far the work is."""

    total: int
    checked: int
    labels: int


def checked_of(labelling: Labelling) -> Checked:
    """How much of the labelled camera was checked."""
    times, arrays = labelling.grid.times(), labelling.here.arrays
    found = np.searchsorted(arrays.t_us, times, "right") > np.searchsorted(arrays.t_us, times, "left")  # both ascend
    return Checked(len(times), int(found.sum()), len(arrays))


def live_words(share: float | None) -> tuple[tuple[str, PaletteIndex], ...]:
    """The line in the picture of a live rally."""
    return ((_live_text(share), PaletteIndex.ASKS),)


def live_html(share: float | None) -> str:
    """What happens to the labels of a live rally."""
    return note_html(_live_text(share), BRAND)


def _live_text(share: float | None) -> str:
    if share is None:
        return "live: the first label saves it as a recording"
    return f"saving the live rally as a recording: {percent(share)}"


def save_html(labelling: Labelling, writer: LabelWriter) -> str:
    """Whether everything is on the disk."""
    if writer.failure is not None:
        return note_html(f"not saved: {html_text(writer.failure)}", theme.BAD)
    if labelling.view.camera not in labelling.saved:
        return note_html("reading the labels", theme.MUTED)
    if writer.waiting:
        return note_html(f"saving {writer.waiting}", BRAND)
    if writer.saved_at is None:
        stored = bool(labelling.here.labels)
        return note_html("all saved" if stored else "nothing to save", theme.GOOD if stored else theme.MUTED)
    return note_html(f"all saved at {time.strftime('%H:%M:%S', time.localtime(writer.saved_at))}", theme.GOOD)


def status_words(
    labelling: Labelling,
    writer: LabelWriter,
    checked: Checked,
    agreement: CameraAgreement | None,
    proposing: float | None = None,
) -> tuple[tuple[str, PaletteIndex], ...]:
    """The line in the picture: it is always in sight. `proposing`: how far the detector is, while it runs.

    The panel has the annotator's name, and says that there is nothing to save.
    """
    view = labelling.view
    if writer.failure is not None:
        save = (("NOT SAVED", PaletteIndex.HULL_REJECTED),)
    elif writer.waiting:
        save = (("saving", PaletteIndex.DRAFT),)
    else:
        stored = writer.saved_at is not None or labelling.here.labels
        save = (("all saved", PaletteIndex.LABEL),) if stored else ()
    if view.repeat:
        return *save, ("second look: place the ball again", PaletteIndex.DRAFT)
    if labelling.asking is not None:
        return *save, (labelling.asking.question, PaletteIndex.ASKS)
    t_us, known = labelling.t_us, labelling.here
    label, draft = known.labels.get(t_us), draft_at(labelling, t_us)
    if label is not None:
        made = label.provenance
        state = f"{label.state.replace('_', ' ')}, {made.source.replace('_', ' ')}{_radius_text(label)}"
        here = (state, STATE_INKS[label.state])
    else:
        here = ("proposed", PaletteIndex.DRAFT) if draft is not None else ("unchecked", PaletteIndex.NO_BALL)
    words = [*save, (f"{checked.checked} of {checked.total}", PaletteIndex.TEXT), here]
    contact = contact_near(labelling.contacts, t_us)
    if contact is not None and abs(contact.t_us - t_us) <= view.window_us / 2:
        words.append((str(contact.kind), PaletteIndex.EPIPOLAR))
    if proposing is not None:
        words.append((f"proposing: {percent(proposing)}", PaletteIndex.DRAFT))
    if agreement is not None:
        words.append((f"{agreement_words(agreement)} {agreement.residual_px:.2f} px", PaletteIndex.EPIPOLAR))
    return tuple(words)


def progress_html(checked: Checked) -> str:
    """The share of the times that somebody has looked at."""
    share = checked.checked / max(checked.total, 1)
    bar = (
        f"<div style='height:6px;border-radius:3px;background:#2c2f37;margin:3px 0'>"
        f"<div style='height:6px;border-radius:3px;width:{100 * share:.1f}%;background:{theme.GOOD}'></div></div>"
    )
    labels = counted(checked.labels, "label")
    if checked.labels > checked.checked:
        labels += f", {checked.labels - checked.checked} between these times"
    text = f"{checked.checked:,} of {counted(checked.total, 'time')} checked, {labels}"
    return f"<div style='font-size:12.5px;padding:2px 12px'>{text}{bar}</div>"


def _radius_text(label: Label) -> str:
    """That nobody knows how large a visible ball is: files of points do not say."""
    return ", radius not known" if label.state.seen and label.r_px is None else ""


def here_html(
    label: Label | None,
    draft: ProposedLabel | None,
    agreement: CameraAgreement | None,
    reason: str,
    labelling: Labelling,
) -> str:
    """What is known at this time."""
    if labelling.asking is not None:
        return note_html(f"<b>not stored:</b> {html_text(labelling.asking.question)}", AMBER)
    if labelling.view.repeat:
        return note_html("second look: place the ball again, without the first label", BRAND)
    if label is not None:
        made = label.provenance
        text = (
            f"<b>{label.state.replace('_', ' ')}</b>, {made.source.replace('_', ' ')} by {html_text(made.annotator)}"
            f"{_radius_text(label)}"
        )
        if label.covariance_px2 is not None:
            sigma = np.sqrt((label.covariance_px2[0] + label.covariance_px2[2]) / 2)
            text += f", &plusmn;{sigma:.2f} px"
        first = note_html(text, theme.GOOD)
    elif draft is not None:
        origin = f" from the {FROM_OTHERS}" if draft.detector == FROM_OTHERS else ""
        first = note_html(f"<b>proposed</b>{origin}: space accepts, R rejects", "#ffe13c")
    else:
        first = note_html("<b>unchecked</b>", theme.MUTED)
    lines = [first]
    if reason:  # before what may fill the lines in sight
        lines.append(note_html(html_text(reason), BRAND))
    if agreement is not None:
        ball = label if label is not None else draft
        r_px = None if ball is None else ball.r_px
        wrong_size = r_px is not None and bool(radius_is_off(r_px, agreement.expected_r_px))
        if wrong_size:
            text = f"radius {r_px:.1f} px, expected {agreement.expected_r_px:.1f} px: a ball there has another size"
            lines.append(note_html(text, theme.BAD))
        colour = theme.GOOD if agreement.residual_px < FAR_PX else theme.BAD
        text = f"{agreement_words(agreement)} {agreement.residual_px:.2f} px, ball {agreement.distance_m:.2f} m away"
        expected = "" if wrong_size else f", expected radius {agreement.expected_r_px:.1f} px"
        lines.append(note_html(f"{text}{expected}", theme.MUTED if wrong_size and colour == theme.GOOD else colour))
        if agreement.off_px:
            lines.append(_residuals_html(agreement))
    return f"<div style='{HERE_STYLE}'>{''.join(lines)}</div>"


def agreement_words(agreement: CameraAgreement) -> str:
    """How many cameras agree, or disagree, as the beginning of a text with the distance; of a pair it is both."""
    count = len(agreement.off_px)
    which = f"{count - len(agreement.left_out)} of {count} cameras" if count else "cameras"
    return f"{which} agree to" if agreement.residual_px < FAR_PX else f"{which} disagree by"


def _residuals_html(agreement: CameraAgreement) -> str:
    """Each camera's distance from the ball of all."""
    parts = []
    for name, off_px in agreement.off_px.items():
        text = f"{html_text(name)}&nbsp;{off_px:.2f}"
        far = name in agreement.left_out or off_px >= FAR_PX
        parts.append(f"<span style='color:{theme.BAD}'>{text}</span>" if far else text)
    return note_html(f"px of each: {', '.join(parts)}", theme.MUTED)


def proposals_html(proposals: Proposals | None, share: float | None, held: bool, *, lost: bool = False) -> str:
    """How far the detector has come, whether a key waits for it, and whether a reload has lost what it proposed."""
    count = 0 if proposals is None else len(proposals)
    if share is not None:
        waits = "; Enter waits for it, Escape cancels" if held else ""
        return note_html(f"proposing: {percent(share)}, {count} so far{waits}", BRAND if held else theme.MUTED)
    if lost and proposals is None:
        return note_html("Proposals are not kept over a reload: I runs the detector again", AMBER)
    text = counted(count, "proposal") if count else "&nbsp;"  # empty, the buttons would move
    return note_html(text, theme.MUTED)
