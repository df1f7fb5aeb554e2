"""The guided tour: what it says, and to whom it opens by itself."""

from app.client_session.tour.tour import TOUR, Tour

__all__ = ["TOUR", "Tour"]
