"""Sizes of files in words."""


def size_text(size: int) -> str:
    """A number of bytes in the unit that suits it."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(1, round(size / 1e3))} kB"
