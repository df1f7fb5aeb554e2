"""What a client that counts pictures does on the page, on a server with two choices of one name."""

import viser

from app.widgets import Choice
from benchmarks.app.many_cameras import PictureVisitor
from tests.waiting import eventually


def test_it_shows_the_pictures_of_watch_whatever_else_has_that_name() -> None:
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    chosen: list[str] = []
    Choice(server.gui, "Show", ("3D", "Pictures"), chosen.append)
    Choice(server.gui, "Show", ("Picture", "3D"), chosen.append)
    visitor = PictureVisitor(server.get_port())
    try:
        visitor.show_pictures()
        eventually(lambda: chosen == ["Pictures"], "the choice of Watch", lambda: chosen)
    finally:
        visitor.close()
        server.stop()
