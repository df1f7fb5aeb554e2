from html.parser import HTMLParser

from benchmarks.perception.comparisons import SeedEstimate, one_line, paragraphs
from benchmarks.perception.page import ReportSection, WindowPicture, cell, html_page, inline_html, markdown_page

NAN, NEVER = float("nan"), float("inf")
SECTIONS = [
    ReportSection("First <b>", ("Say `a<b` & more.",)),
    ReportSection("Second", ("long " * 40,), ("one", "two"), (("`x`", '<script>alert("1")</script>'),)),
]


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.sources: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs) -> None:
        self.found.append(tag)
        self.sources += [str(value) for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag) -> None:
        assert self.open.pop() == tag


def test_the_page_is_whole_needs_nothing_else_and_text_stays_text() -> None:
    page = html_page(SECTIONS, [WindowPicture(b"png", 'real1 "a" <i>')])
    tags = Tags()
    tags.feed(page)
    assert not tags.open and "script" not in tags.found and "b" not in tags.found and "i" not in tags.found
    assert tags.sources == ["data:image/png;base64,cG5n"]
    assert "&lt;script&gt;" in page and 'alt="real1 &quot;a&quot; &lt;i&gt;"' in page
    assert "<img" not in html_page(SECTIONS, [])


def test_the_pictures_come_after_the_figures_and_an_interval_has_a_line_of_its_own() -> None:
    tables = [ReportSection(f"Part {number}", (), ("a",), (("0.5 [0.1, 0.9]",),)) for number in range(6)]
    page = html_page(tables, [WindowPicture(b"png", "ball")])
    assert page.index("Part 3") < page.index("<img") < page.index("Part 4")
    assert page.count("<td>0.5<br><small>[0.1, 0.9]</small></td>") == 6


def test_code_is_marked_and_escaped() -> None:
    assert inline_html("`a<b` & c") == "<code>a&lt;b</code> &amp; c"


def test_the_markdown_page_has_lines_of_a_readable_length_and_names_the_other_page() -> None:
    page = markdown_page(SECTIONS, "other.html")
    assert "[other.html](other.html)" in page and "## Second" in page and "| one | two |" in page
    assert max(len(line) for line in page.splitlines() if line.startswith("long")) <= 118


def test_a_cell_has_its_interval_and_says_when_nobody_knows_or_never() -> None:
    assert cell(SeedEstimate(0.5, 0.25, 1.0), ".2f") == "0.50 [0.25, 1.00]"
    assert cell(SeedEstimate(0.5, NAN, NAN), ".1f") == "0.5" and cell(SeedEstimate(NAN, 1, 2), ".1f") == "-"
    assert cell(SeedEstimate(NEVER, 1.0, NEVER), ".0f") == "never [1, never]"


def test_paragraphs_are_lines_that_are_filled_in() -> None:
    assert paragraphs("\na\nb {x:.1f}\n\nc\n", x=1.25) == ("a b 1.2", "c")
    assert one_line("a\nb") == "a b"
