"""The proposals, on functions whose best is known."""

import pytest

from core.config import get_setting, replace_setting
from core.detection import DetectorConfig
from core.tuning.parameters import choose_parameters
from core.tuning.search import FOREST_FROM, Search, Values

START = replace_setting(DetectorConfig(), ("cluster", "eps_px"), 3.21)  # on no step
PARAMETERS = choose_parameters("auto", START, ["cluster.eps_px", "geometry", "polarity.leading_polarity"])


def worth(values: Values) -> float:
    """Best at eps 7, and nothing else but the polarity counts, a little."""
    eps = values["cluster.eps_px"]
    assert isinstance(eps, float)
    return -abs(eps - 7.0) - 0.1 * (values["polarity.leading_polarity"] == "off")


def follow(seed: int, batches: int, *, size: int = 8) -> tuple[list[Values], Search]:
    search, asked = Search(PARAMETERS, START, seed), []
    for number in range(batches):
        proposals = search.ask(size if number else 1)
        search.tell([worth(values) for values in proposals])
        asked += proposals
    return asked, search


def test_the_first_proposal_is_where_it_starts_exactly() -> None:
    first = follow(0, 1)[0][0]
    assert first == {parameter.name: get_setting(START, parameter.spec.path) for parameter in PARAMETERS}


def test_the_same_seed_asks_the_same_and_another_one_does_not() -> None:
    assert follow(3, 5)[0] == follow(3, 5)[0] != follow(4, 5)[0]


def test_it_comes_nearer_to_the_best() -> None:
    asked, _ = follow(1, 8)
    assert max(map(worth, asked)) > -1.0 > worth(asked[0]) + 2.0


@pytest.mark.parametrize("batches", [3, 1 + FOREST_FROM // 8 + 1], ids=["by correlation", "by a forest"])
def test_what_counts_is_called_important(batches: int) -> None:
    _, search = follow(2, batches)
    shares = search.importance()
    assert next(iter(shares)) == "cluster.eps_px" and shares["cluster.eps_px"] > 0.4
    assert sum(shares.values()) == pytest.approx(1.0) and set(shares) == {one.name for one in PARAMETERS}
    assert list(shares.values()) == sorted(shares.values(), reverse=True)


def test_nothing_is_called_important_where_all_trials_are_equal() -> None:
    search = Search(PARAMETERS, START, 0)
    search.ask(8)
    search.tell([0.5] * 8)
    assert search.importance() == {}
