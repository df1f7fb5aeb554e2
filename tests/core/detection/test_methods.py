import pytest

from core.config import replace_setting
from core.detection import FastDetector, RefinedDetector, auto_config, make_detector
from core.detection.ebpp.detector import EbppDetector
from core.detection.fe_fusion.detector import FeFusionDetector
from core.detection.methods import FRAME_METHODS
from core.errors import CommandError
from core.events import SensorSize

SENSOR = SensorSize(64, 48)


def test_paper_overrules_what_a_config_says_about_polarity_and_auto_does_not() -> None:
    mine = replace_setting(auto_config(), ("polarity", "leading_polarity"), "off")
    for method, leading in (("auto", "off"), ("paper", "on")):
        detector = make_detector(method, SENSOR, mine)
        assert isinstance(detector, FastDetector) and detector.config.polarity.leading_polarity == leading


@pytest.mark.parametrize(("method", "section"), [("refined", "refined"), ("ebpp", "ebpp"), ("fe-fusion", "fe_fusion")])
def test_a_method_without_stages_runs_with_its_own_section(method: str, section: str) -> None:
    name = {"refined": "radius_max_px", "ebpp": "roi_expand_px", "fe-fusion": "size_min"}[method]
    mine = replace_setting(auto_config(), (section, name), 77)
    detector = make_detector(method, SENSOR, mine)
    assert isinstance(detector, RefinedDetector | EbppDetector | FeFusionDetector)
    assert detector.config is getattr(mine, section)


@pytest.mark.parametrize("method", FRAME_METHODS)
def test_a_method_that_looks_at_pictures_says_where_it_can_be_used(method: str) -> None:
    with pytest.raises(CommandError, match=f"{method}.*pictures.*rallyscope detect"):
        make_detector(method, SENSOR)


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(CommandError, match="auto"):
        make_detector("magic", SENSOR)
