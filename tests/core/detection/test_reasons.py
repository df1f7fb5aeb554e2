"""Reasons as text, and their count over many windows."""

import math

from core.detection.reasons import NO_REASON, Limit, Reason, ReasonCounter, failed_limits, reasons_of


def test_a_reason_reads_as_value_and_limit() -> None:
    assert Reason("residual", "refined.residual_px", 0.914, 0.55, "px").text == "residual 0.914 px > 0.55"
    assert Reason("events", None, 20_458.0, 6000.0).text == "events 20458 > 6000"
    assert Reason("fill", "refined.fill_min", 0.1, 0.33).text == "fill 0.1 < 0.33"
    assert Reason("radius", "refined.radius_min_px", 2.998, 3.0, "px").text == "radius 2.998 px < 3"
    assert Reason("no circle").text == "no circle"


def test_what_is_within_its_limit_is_no_reason_and_not_a_number_is_one() -> None:
    limits = (Limit("low", "a.low", 1.0, math.inf), Limit("high", None, -math.inf, 2.0))
    assert failed_limits([1.0, 2.0], limits) == ()
    assert [(one.setting, one.limit) for one in failed_limits([0.5, 3.0], limits)] == [("a.low", 1.0), (None, 2.0)]
    assert len(failed_limits([math.nan, 1.0], limits)) == 1


def test_reasons_are_counted_by_windows_with_the_median_of_their_values() -> None:
    counter = ReasonCounter()
    for value in (1.0, 2.0, 9.0):
        counter.add([Reason("wide", "a.wide", value, 0.5), Reason("wide", "a.wide", 7.0, 0.5)])
    counter.add([Reason("none")])
    wide, none = counter.counts()
    assert counter.windows == 4
    assert (wide.reason, wide.setting, wide.windows, wide.value, wide.limit) == ("wide", "a.wide", 3, 2.0, 0.5)
    assert (none.windows, none.value, none.limit) == (1, None, None)


def test_a_count_without_any_value_reads_as_the_sentence_of_its_windows() -> None:
    counter = ReasonCounter()
    counter.add([Reason("votes", "a.votes", None, 80.0, sentence="no circle has 50% of the 80 votes")])
    assert counter.counts()[0].text == "no circle has 50% of the 80 votes"
    counter.add([Reason("votes", "a.votes", 60.0, 80.0)])
    assert counter.counts()[0].text == "votes 60 < 80", "of the windows that have one"


def test_a_detector_without_reasons_says_that_it_gives_none() -> None:
    class Silent:
        pass

    class Empty:
        def why_not(self) -> tuple[Reason, ...]:
            return ()

    assert reasons_of(Silent()) == reasons_of(Empty()) == (NO_REASON,)
