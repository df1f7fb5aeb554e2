import re
from pathlib import Path

import pytest

from app.formatting import GLOSSARY, PAGE, tooltip

ROWS = dict(
    re.findall(
        r"^\| ([^|]+) \| ([^|]+) \|$", (Path(__file__).parents[3] / PAGE).read_text(encoding="utf-8"), re.MULTILINE
    )
)


@pytest.mark.parametrize("word", GLOSSARY)
def test_the_page_says_of_a_word_what_its_tooltip_says(word: str) -> None:
    assert ROWS[word] == GLOSSARY[word]
    assert tooltip(word) == f"{word}: {GLOSSARY[word]} (docs/use/glossary.md)"


def test_words_are_in_order() -> None:
    assert list(GLOSSARY) == sorted(GLOSSARY, key=str.lower)
    assert [row for row in ROWS if row != "word"] == list(GLOSSARY)
