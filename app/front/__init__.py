"""The front door of the app: who may come in, and the page that they get, which is viser's with a script of ours."""

from app.front.admission import Admission, make_token
from app.front.door import FrontDoor, open_front_door
from app.front.pages import Visit

__all__ = ["Admission", "FrontDoor", "Visit", "make_token", "open_front_door"]
