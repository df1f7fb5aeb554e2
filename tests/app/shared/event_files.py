"""Small event files to open."""

from pathlib import Path

import numpy as np


def write_npz(path: Path, count: int = 500) -> Path:
    """Events at the corner of a sensor whose size the file does not say."""
    k = np.arange(count)
    np.savez(path, t=1000 * k, x=k % 30, y=k % 20, p=k % 2)
    return path


def write_csv(path: Path, count: int = 500) -> Path:
    """The same as text."""
    rows = "\n".join(f"{1000 * k},{k % 30},{k % 20},{k % 2}" for k in range(count))
    path.write_text(f"t,x,y,p\n{rows}\n")
    return path
