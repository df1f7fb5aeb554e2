"""Charts by matplotlib: SVG files without background and with grey lines, for light and dark pages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RallyscopeError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK: Final = "#767676"
"""Grey that is legible on white and on dark pages."""
STYLE: Final[dict[Any, Any]] = {
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
    "svg.hashsalt": "rallyscope",  # the same chart is the same file
    "svg.fonttype": "none",
}


def heat_map(
    path: Path,
    title: str,
    x_title: str,
    y_title: str,
    x_bins: Sequence[str],
    y_bins: Sequence[str],
    shares: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> None:
    """Write `shares` (rows, columns) in [0, 1] as cells, with the counts they are of; those of nothing stay empty.

    Args:
        path: the picture that is written.
        title: over it.
        x_title: under the columns.
        y_title: beside the rows.
        x_bins: names of the columns.
        y_bins: names of the rows.
        shares: (rows, columns) in [0, 1].
        counts: (rows, columns) of how many.
    """
    with chart_axes(path, (1.6 + 0.9 * len(x_bins), 1 + 0.5 * len(y_bins)), title, x_title, y_title) as axes:
        axes.pcolormesh(np.ma.masked_where(counts == 0, shares), cmap="Oranges", vmin=0, vmax=1)
        axes.set_xticks(np.arange(len(x_bins)) + 0.5, x_bins)
        axes.set_yticks(np.arange(len(y_bins)) + 0.5, y_bins)
        for row, column in np.argwhere(counts):
            share, count = shares[row, column], counts[row, column]
            ink = "white" if share > 0.6 else "black"
            label = f"{100 * share:.0f} %\nof {count:,}"
            axes.text(column + 0.5, row + 0.5, label, ha="center", va="center", color=ink, fontsize=8)


@contextmanager
def chart_axes(path: Path, size_in: tuple[float, float], title: str, x_title: str, y_title: str) -> Iterator[Axes]:
    """Axes to draw on; the file is written at the end.

    Args:
        path: the picture that is written.
        size_in: width and height, inches.
        title: over it.
        x_title: under the x axis.
        y_title: beside the y axis.

    Raises:
        RallyscopeError: without matplotlib.
    """
    with chart_figure(size_in) as figure:
        axes = figure.add_subplot()
        figure.suptitle(title, fontsize=11)
        axes.set(xlabel=x_title, ylabel=y_title)
        yield axes
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="svg", transparent=True, metadata={"Date": None})


@contextmanager
def chart_figure(size_in: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure in one style for all reports.

    Raises:
        RallyscopeError: without matplotlib.
    """
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        raise RallyscopeError("charts need matplotlib", remedy="pip install 'rallyscope[bench]'") from error
    with rc_context(STYLE):
        yield Figure(size_in, layout="constrained")
