"""What a slider's box may send while somebody types into it."""

import pytest

from app.modes.tune.settings import is_half_typed
from core.config import field_specs
from core.detection import DetectorConfig

SPECS = {spec.path: spec for spec in field_specs(DetectorConfig)}


@pytest.mark.parametrize(("value", "expected"), [(5, True), (49, True), (50, False), (500, False), (20_001, True)])
def test_a_number_outside_of_the_bounds_is_half_typed(value: int, expected: bool) -> None:
    assert is_half_typed(SPECS["window", "window_us"], value) is expected


def test_boxes_and_choices_are_never_half_typed() -> None:
    for spec in SPECS.values():
        assert not is_half_typed(spec, spec.default), spec.path
    assert not is_half_typed(SPECS["window", "window_us"], "500")
