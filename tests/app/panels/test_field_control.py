import pytest

from app.panels.field_control import field_label
from core.config import field_specs
from core.detection import DetectorConfig


@pytest.mark.parametrize(
    ("path", "label"),
    [
        (("refined", "speed_max_px_per_ms"), "speed max [px/ms]"),
        (("cluster", "time_scale_px_per_ms"), "time scale [px/ms]"),
        (("localise", "radius_max_px"), "radius max [px]"),
        (("geometry", "solidity_min"), "solidity min"),
    ],
)
def test_a_field_is_shown_with_its_unit_set_apart(path: tuple[str, ...], label: str) -> None:
    (spec,) = (spec for spec in field_specs(DetectorConfig) if spec.path == path)
    assert field_label(spec) == label
