"""The list of moments that are to be labelled: one file of a workspace, for all its annotators."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from core.errors import WRITE_REMEDY, LabelError
from core.files import replace_file
from core.text import parse_json

FILE: Final = "to-label.json"
FORMAT: Final = "rallyscope-to-label"
LARGEST_US: Final = 2**62


def write_moments(folder: Path, moments: Mapping[str, Sequence[int]]) -> None:
    """Replace the list by these times (us) of each recording, by its uuid.

    Raises:
        LabelError: if it cannot be written.
    """
    listed = {uuid: sorted(set(times)) for uuid, times in moments.items()}
    try:
        replace_file(folder / FILE, json.dumps({"format": FORMAT, "moments_us": listed}).encode(), durable=True)
    except OSError as error:
        where = folder / FILE
        raise LabelError("cannot write the list", got=error.strerror, where=where, remedy=WRITE_REMEDY) from error


def read_moments(folder: Path, uuid: str) -> tuple[int, ...]:
    """The times that are to be labelled in a recording, ascending; none where there is no list.

    Raises:
        LabelError: if the file is not such a list.
    """
    path = folder / FILE
    try:
        found = parse_json(path.read_text(encoding="utf-8"))
        times = found["moments_us"].get(uuid, [])
        if found["format"] != FORMAT or not all(type(one) is int and 0 <= one < LARGEST_US for one in times):
            raise ValueError(times)
        return tuple(sorted(times))
    except FileNotFoundError:
        return ()
    except (OSError, KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        remedy = "select the balls again in Watch, or remove it"
        raise LabelError("not a list of moments to label", where=path, remedy=remedy) from error
