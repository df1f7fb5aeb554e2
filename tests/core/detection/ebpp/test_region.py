"""The three rules for the region that `ebpp` searches next."""

import pytest

from core.detection.ebpp import EbppDetector
from core.detection.ebpp_config import EbppConfig
from core.detection.ebpp_region import FollowedCircle, follow, region_of
from core.detection.stages.roi import Roi
from core.events import Events, SensorSize, Window

SENSOR = SensorSize(320, 240)


def followed(config: EbppConfig) -> FollowedCircle | None:
    """Two circles of 8 px, 10 px apart along u, 2 ms one after the other."""
    first = follow(None, (100.0, 60.0, 8.0), 2000, config)
    return follow(first, (110.0, 60.0, 8.0), 4000, config)


def test_fixed_is_the_square_around_the_last_circle_whatever_its_size() -> None:
    config = EbppConfig(region="fixed", roi_expand_px=30.0)
    assert region_of(None, 2000, config) is None, "the whole sensor"
    assert region_of(followed(config), 6000, config) == Roi(80, 140, 30, 90)


def test_scaled_is_a_square_of_so_many_radii() -> None:
    config = EbppConfig(region="scaled", region_radii=2.0)
    assert region_of(followed(config), 6000, config) == Roi(94, 126, 44, 76)


def test_moving_goes_on_as_the_circle_moved_and_through_misses() -> None:
    config = EbppConfig(region="moving", region_radii=2.0, misses_to_reset=3)
    last = followed(config)
    assert region_of(last, 6000, config) == Roi(104, 136, 44, 76)
    last = follow(last, None, 6000, config)
    assert region_of(last, 8000, config) == Roi(114, 146, 44, 76)
    again = follow(last, (140.0, 60.0, 8.0), 8000, config)
    assert again is not None and again.misses == 0
    assert again.motion_px_per_us == pytest.approx((30.0 / 4000, 0.0)), "over the two windows since the last circle"


@pytest.mark.parametrize("region", ["fixed", "scaled", "moving"])
def test_after_so_many_misses_the_whole_sensor_is_searched(region) -> None:
    config = EbppConfig(region=region, misses_to_reset=2)
    last = follow(followed(config), None, 6000, config)
    assert region_of(last, 8000, config) is not None
    assert follow(last, None, 8000, config) is None


def test_a_moving_region_keeps_a_ball_that_leaves_a_square_of_its_size(make_scene, make_flight) -> None:
    """5 px/ms over a gap of two windows are 30 px: 2 radii around the last place do not reach that far."""
    flight = make_flight(u_px=20.0, v_px=100.0, du_px_per_ms=5.0)
    windows = make_scene(flight, duration_us=50_000).windows(2000)
    after_gap = {}
    for region in ("scaled", "moving"):
        detector = EbppDetector(EbppConfig(region=region, region_radii=2.0, misses_to_reset=10, delay_us=0), SENSOR)
        found = [detector.step(window) for window in windows[:10]]
        assert found[-1] is not None
        for window in windows[10:12]:
            assert detector.step(Window(Events.empty(SENSOR), window.start_us, window.end_us)) is None
        after_gap[region] = detector.step(windows[12])
    u_px = flight.centre(windows[12].end_us)[0]
    moving, scaled = after_gap["moving"], after_gap["scaled"]
    assert moving is not None and moving.u_px == pytest.approx(u_px, abs=3.0)
    assert scaled is None or abs(scaled.u_px - u_px) > 8.0, "at most the edge that it left behind"
