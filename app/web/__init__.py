"""The app's web side: access policy, and viser's page with a script of ours."""

from app.web.access_policy import Admission, make_token
from app.web.gateway import Gateway, open_gateway
from app.web.pages import PageConnection

__all__ = ["Admission", "Gateway", "PageConnection", "make_token", "open_gateway"]
