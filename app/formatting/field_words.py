"""The name of a field of a config as its control says it."""

from __future__ import annotations

import itertools
import re
from typing import Final

UNITS = {"us": "µs", "ms": "ms", "px": "px", "hz": "Hz", "s": "s", "rad": "rad", "mps": "m/s", "m": "m", "deg": "°"}
FIELD_OF_A_CLASS: Final = re.compile(r"^[A-Z]\w*Config\.(\w+)")
SEVERAL_WORDS: Final = re.compile(r"\b[a-z0-9]+(?:_[a-z0-9]+)+\b")


def field_words(field: str) -> str:
    """The unit in its suffix is set apart: `eps_px` -> "eps [px]"."""
    for above, below in itertools.product(UNITS, UNITS):
        if field.endswith(f"_{above}_per_{below}"):
            return f"{field.removesuffix(f'_{above}_per_{below}').replace('_', ' ')} [{UNITS[above]}/{UNITS[below]}]"
    name, _, suffix = field.rpartition("_")
    if name and suffix in UNITS:
        return f"{name.replace('_', ' ')} [{UNITS[suffix]}]"
    return field.replace("_", " ")


def in_control_words(details: str) -> str:
    """What is said of a field of a config, `LocaliseConfig.radius_max_px; expected ...`, in the words of its control.

    Anything else stays as it is: what has underscores there may be the name of a file.
    """
    of_class = FIELD_OF_A_CLASS.match(details)
    if of_class is None:
        return details
    rest = SEVERAL_WORDS.sub(lambda found: field_words(found[0]), details[of_class.end() :])
    return f'"{field_words(of_class[1])}"{rest}'
