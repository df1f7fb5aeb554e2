"""What HDF5 says when it cannot read, in words that help."""

from __future__ import annotations

from typing import Final

UNREADABLE: Final = (OSError, ValueError, RuntimeError)


def explain(error: Exception) -> str:
    """One clause for a note or an error."""
    text = " ".join(str(error).split())
    if "filter" in text or "plugin" in text:
        return f"its compression needs a plug-in (pip install 'rallyscope[dsec]'): {text}"
    return text
