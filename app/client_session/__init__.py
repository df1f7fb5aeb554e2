"""What a browser brings along when it comes, and finds again: the link in its address, and its settings."""

from app.client_session.session_page import SessionPage

__all__ = ["SessionPage"]
