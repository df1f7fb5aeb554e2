from app.words.notices import LONGEST_TITLE, notice_of
from core.errors import CommandError, LinkError, NotReadyError


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
