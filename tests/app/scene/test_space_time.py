"""From where the box of space and time is seen."""

import math

import numpy as np
import pytest

from app.pictures.canvas import Region
from app.scene.space_time import FROM, above_panel
from app.views.space_time import SpaceTimeBox
from app.views.viewpoint import Viewpoint
from core.geometry import look_at


def seen(viewpoint: Viewpoint, ps: np.ndarray, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows in a window from 0 to 1, from the left and from the top."""
    towards = (ps - np.array(viewpoint.position)) @ look_at(viewpoint.position, viewpoint.look_at)[:3, :3]
    x, y = (towards[:, :2] / towards[:, 2:] / math.tan(viewpoint.fov_rad / 2)).T
    return 0.5 + x / aspect / 2, 0.5 + y / 2


@pytest.mark.parametrize("panel_share", [0.0, 0.35, 0.6])
@pytest.mark.parametrize(("aspect", "shape"), [(1.2, (160, 90)), (2.4, (160, 90)), (0.6, (64, 64))])
def test_the_whole_box_is_above_the_panel_and_fills_what_is_free(aspect, shape, panel_share) -> None:
    corners = SpaceTimeBox(Region(0, 0, *shape), 0, 34_000).edges(0, 34_000).reshape(-1, 3)
    columns, rows = seen(above_panel(FROM, corners, aspect, panel_share), corners, aspect)
    assert columns.min() > 0 and columns.max() < 1
    assert rows.min() > 0 and rows.max() < 1 - panel_share
    assert max(np.ptp(columns), np.ptp(rows) / (1 - panel_share)) > 0.6
