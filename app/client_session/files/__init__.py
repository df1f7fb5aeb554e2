"""Open file: the list of files, uploads, and their import as recordings."""

from app.client_session.files.file_opening import FileOpening

__all__ = ["FileOpening"]
