import pytest

from app.formatting.percent import percent


@pytest.mark.parametrize(
    ("done", "of", "said"),
    [(0, 260, "0 %"), (1, 260, "1 %"), (130, 260, "50 %"), (259, 260, "99 %"), (260, 260, "100 %")],
)
def test_only_all_is_a_hundred_per_cent_and_only_nothing_is_none(done: int, of: int, said: str) -> None:
    assert percent(done / of) == said
