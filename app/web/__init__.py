"""The front door of the app: who may come in, and the page that they get, which is viser's with a script of ours."""

from app.web.access_policy import Admission, make_token
from app.web.gateway import Gateway, open_gateway
from app.web.pages import PageConnection

__all__ = ["Admission", "Gateway", "PageConnection", "make_token", "open_gateway"]
