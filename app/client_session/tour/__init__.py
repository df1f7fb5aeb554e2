"""The guided tour: its texts, and when it opens by itself."""

from app.client_session.tour.tour import TOUR, Tour

__all__ = ["TOUR", "Tour"]
