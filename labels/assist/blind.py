"""Blind repeats: a few labels are asked for again without showing them, to measure the annotator's own noise."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from labels.store import LabelStore, Layer

SHARE = 0.05
"""One in twenty."""
MIN_BETWEEN = 20
"""Labels made after one before it is asked for again, so that it is not simply remembered."""


def is_blind_sample(layer: Layer, t_us: int, share: float = SHARE) -> bool:
    """Whether this label is among those to repeat. Fixed by its identity: neither order nor restarts change it."""
    identity = f"{layer.recording_uuid}\0{layer.camera}\0{layer.annotator}\0{t_us}".encode()
    return int.from_bytes(hashlib.blake2b(identity, digest_size=8).digest(), "big") < share * 2**64


def next_blind(
    first: LabelStore, second: LabelStore, *, share: float = SHARE, recent_us: Sequence[int] = ()
) -> int | None:
    """The next time to ask for again: the oldest label of the sample that `second`, the blind layer, does not have.

    `recent_us` are the times that the annotator worked on last; the latest `MIN_BETWEEN` of them are not asked yet.
    Labels that say there is no ball are asked for too: states have noise as well.

    Args:
        first: the annotator's labels.
        second: the blind layer.
        share: of the labels that are asked for again, 0 to 1.
        recent_us: times that were worked on last, the newest at the end.
    """
    skip = set(recent_us[-MIN_BETWEEN:])
    waiting = [
        label
        for label in first.all()
        if label.t_us not in skip and is_blind_sample(first.layer, label.t_us, share) and second.at(label.t_us) is None
    ]
    oldest = min(waiting, key=lambda label: (label.provenance.made_at_us, label.t_us), default=None)
    return None if oldest is None else oldest.t_us
