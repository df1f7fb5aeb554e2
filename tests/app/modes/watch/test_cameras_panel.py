"""Which pictures the panel beside the scene offers full size, with a server of its own."""

from collections.abc import Iterator

import pytest
import viser

from app.modes.watch.cameras_panel import SCENE, CamerasPanel

PNG = b""


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    yield server
    server.stop()


def offered(server: viser.ViserServer, panel: CamerasPanel, names: tuple[str, ...]) -> tuple[str, ...]:
    panel.show(dict.fromkeys(names, PNG), dict.fromkeys(names, "used"))
    (larger,) = (
        one
        for one in server.gui._gui_input_handle_from_uuid.values()
        if isinstance(one, viser.GuiDropdownHandle) and one.label == "Larger"
    )
    return larger.options


def test_a_frame_camera_beside_two_event_cameras_is_offered_full_size_too(server) -> None:
    panel = CamerasPanel(server.gui, lambda camera: None)
    assert offered(server, panel, ("left", "right", "rgb")) == (SCENE, "left", "right", "rgb")
