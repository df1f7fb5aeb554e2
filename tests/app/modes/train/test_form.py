"""What a browser sends as a form."""

import dataclasses

import pytest

from app.modes.train.form import ADVANCE, SEEN_AS, FormValues, plan_of_form
from app.modes.train.plan import SOURCES, TrainingPlan, run_of_plan
from core.errors import ConfigError

FORM = FormValues("ddpg", "case", "discard", "3, 5", "80, 90", "as soon as 98 % come back", "exactly", 2, 7.0)


def test_a_form_is_a_plan() -> None:
    expected = TrainingPlan(
        agent="ddpg",
        reward="case",
        replay="discard",
        speeds_mps=(3.0, 5.0),
        episodes=(80, 90),
        advance="converged",
        source="truth",
        seeds=2,
        first_seed=7,
    )
    assert plan_of_form(FORM) == expected


def test_every_way_to_see_a_ball_and_to_end_a_stage_has_words() -> None:
    assert set(SEEN_AS.values()) == set(SOURCES) and set(ADVANCE.values()) == {"episodes", "converged"}


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(FormValues)])
@pytest.mark.parametrize("value", [None, "../../etc", ["a"], {"a": 1}, float("nan"), float("inf"), 1.5, -1e300, True])
def test_garbage_is_refused_in_one_line(name: str, value: object) -> None:
    with pytest.raises(ConfigError) as caught:
        run_of_plan(plan_of_form(dataclasses.replace(FORM, **{name: value})))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300
