"""How values and errors are shown to a person."""

import pytest

from app.formatting import (
    GLOSSARY,
    LONGEST_TITLE,
    field_words,
    notice_of,
    percent,
    share_text,
    size_text,
    with_dashes_explained,
)
from app.panels.field_control import field_label
from core.config import FieldSpec
from core.detection.stages.localise import LocaliseConfig
from core.errors import CommandError, ConfigError, LinkError, NotReadyError


def test_the_title_says_what_did_not_work_and_the_text_where_and_what_to_do() -> None:
    error = CommandError("another export runs", got="rally-3.rrd", remedy="wait for it, or cancel it")
    assert notice_of(error) == ("Another export runs", "got rally-3.rrd; wait for it, or cancel it")
    placed = CommandError("no such file", where="clip.raw")
    assert notice_of(placed) == ("No such file", "clip.raw")
    assert notice_of(NotReadyError("not ready yet", share=0.5)) == ("Not ready yet", "")


def test_a_long_message_is_whole_in_the_text() -> None:
    title, text = notice_of(LinkError("refused: " + "many words " * 20))
    assert len(title) <= LONGEST_TITLE + 4 and title.startswith("Refused: many words")
    assert text.count("many") == 20


def test_a_setting_is_called_what_its_slider_is_called() -> None:
    with pytest.raises(ConfigError) as raised:
        LocaliseConfig(radius_min_px=9.0, radius_max_px=6.0)
    title, text = notice_of(raised.value)
    assert title == "No radius is allowed" and text.startswith('"radius max [px]"; expected radius max [px] above 9')
    slider = FieldSpec(("localise", "radius_max_px"), float, 24.0, None, (), "")
    assert f'"{field_label(slider)}"' in text


def test_a_size_has_two_digits_or_more_in_the_largest_unit_that_it_fills() -> None:
    sizes = (0, 999, 1_000, 24_600, 2_000_000, 21_300_000, 1_500_000_000)
    assert [size_text(size) for size in sizes] == [
        "0 bytes", "999 bytes", "1.0 kB", "25 kB", "2.0 MB", "21 MB", "1.5 GB"
    ]  # fmt: skip


def test_the_name_of_a_file_stays_as_it_is() -> None:
    error = ConfigError("unknown setting 'radius_px'", where="my_config.toml")
    assert notice_of(error) == ("Unknown setting 'radius_px'", "my_config.toml")


@pytest.mark.parametrize(
    ("done", "of", "said"),
    [(0, 260, "0 %"), (1, 260, "1 %"), (130, 260, "50 %"), (259, 260, "99 %"), (260, 260, "100 %")],
)
def test_only_all_is_a_hundred_per_cent_and_only_nothing_is_none(done: int, of: int, said: str) -> None:
    assert percent(done / of) == said


@pytest.mark.parametrize(
    ("found", "of", "said"),
    [(0, 2184, "0.000"), (1, 2184, "0.001"), (1092, 2184, "0.500"), (2183, 2184, "0.999"), (2184, 2184, "1.000")],
)
def test_only_a_whole_share_reads_1_and_only_an_empty_one_0(found: int, of: int, said: str) -> None:
    assert share_text(found / of) == said


def test_a_share_of_nothing_is_a_dash() -> None:
    assert share_text(float("nan")) == "-"


@pytest.mark.parametrize("cell", ["-", "- / 0.000", "0.5 / -"])
def test_a_table_with_dashes_says_what_they_stand_for(cell: str) -> None:
    assert with_dashes_explained(f"<td>{cell}</td>").endswith("<div>-: no ball was found or asked for</div>")
    assert with_dashes_explained("<td>left-hand -0.5 / 1</td>") == "<td>left-hand -0.5 / 1</td>"


def test_a_label_and_a_tooltip_are_understood_without_the_neighbour_above() -> None:
    assert field_words("stretch_max_ms") == "edge latency, max [ms] (stretch max)"
    assert not [word for word, meaning in GLOSSARY.items() if meaning.startswith(("The same", "Of "))]


@pytest.mark.parametrize(
    ("reason", "field"),
    [
        ("events inside", "inside_max"),
        ("coverage of the weaker edge", "both_edges_min"),
        ("one polarity all round", "all_round_min"),
        ("spread of the radii", "steady_radius"),
    ],
)
def test_a_slider_has_the_words_of_the_reason_that_leads_to_it(reason: str, field: str) -> None:
    assert field_words(field).startswith(reason) and f"({field.replace('_', ' ')})" in field_words(field)
