"""Where the cameras stand, by clicking the table's corners in their pictures."""

from app.modes.watch.table.panel import TablePanel

__all__ = ["TablePanel"]
