"""Open file: what a browser may open, what it sends, and how that becomes the recording that it shows."""

from app.client_session.files.file_opening import FileOpening

__all__ = ["FileOpening"]
