"""A browser's session: the link in its address, its stored settings, files it opens, event pictures, and the tour."""

from app.client_session.session_page import SessionPage

__all__ = ["SessionPage"]
