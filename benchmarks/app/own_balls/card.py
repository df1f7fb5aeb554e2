"""The card of a set: what the files say of it, and what a reader of its figures should know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict

from benchmarks.app.own_balls.labelled_set import OwnSet, count_by_source, count_by_state


def set_card(own: OwnSet) -> dict[str, object]:
    """Cameras, duration, and how many labels came about how. What a file cannot know is for the one who recorded."""
    first = own.first_looks()
    return {
        "recordings": [asdict(card) for card in own.recordings],
        "seconds": sum(card.seconds for card in own.recordings),
        "without_labels": [card.recording for card in own.recordings if not card.labels],
        "annotators": {
            name: {
                "labels": sum(len(layer.labels) for layer in own.first_looks(name)),
                "by_source": count_by_source(own.first_looks(name)),
                "by_state": count_by_state(own.first_looks(name)),
                "second_looks": sum(len(one.labels) for one in own.layers if one.blind and one.annotator == name),
            }
            for name in own.annotators
        },
        "labels": sum(len(layer.labels) for layer in first),
        "proposed_by": dict(sum((Counter(layer.proposed_by) for layer in first), Counter())),
    }


def set_remarks(own: OwnSet) -> Iterator[str]:
    """Sentences."""
    first = own.first_looks()
    proposed = sum((Counter(layer.proposed_by) for layer in first), Counter())
    if accepted := proposed.total():
        who = ", ".join(sorted(proposed))
        yield (
            f"{accepted} of {sum(len(layer.labels) for layer in first)} labels are accepted proposals of {who}, and "
            "favour the detector that made them: read the rows `by hand` first"
        )
    copied = count_by_source(first).get("interpolated", 0)
    if copied:
        yield f"{copied} labels are interpolated: nobody looked at each of them"
    if not any(layer.blind for layer in own.layers) and len(own.annotators) < 2:
        yield "nobody has looked twice: how exact the labels are is not known, nor whether an error below that is one"
    hidden = count_by_state(first).get("occluded", 0)
    if hidden:
        yield f"{hidden} balls are labelled as occluded: no method is asked for them"
    notes = [card.recording for card in own.recordings if card.notes]
    if notes:
        yield f"`rallyscope info` has notes on {', '.join(notes)}"
