"""What a person says about a recording: the label model, its store, assistance and exchange formats.

No user interface.
"""

from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.model import Label, LabelState, PositionSource
from labels.score import score_labels
from labels.store import LabelStore

__all__ = [
    "FORMATS",
    "ExportOptions",
    "ImportContext",
    "Label",
    "LabelSet",
    "LabelState",
    "LabelStore",
    "PositionSource",
    "score_labels",
]
