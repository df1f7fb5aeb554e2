"""The report as Markdown, and as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import re
import textwrap
from collections.abc import Sequence
from html import escape
from typing import Final

from benchmarks.perception.pictures import WindowPicture
from benchmarks.perception.sections import ReportSection
from benchmarks.perception.words import PICTURE_WORDS, PICTURES, TITLE, one_line
from core.text.markdown_table import markdown_table

LINE: Final = 118
"""Characters of a line of Markdown."""
BEFORE_PICTURES: Final = 4
"""Sections: the conditions, the two tables of figures, and the comparisons."""
STYLE: Final = """
:root { color-scheme: light; }
body { margin: 2rem auto; max-width: 76rem; padding: 0 1.5rem; background: #fff; color: #222;
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; } h2 { margin-top: 2.2rem; font-size: 1.2rem; color: #b4510b; }
p { max-width: 60rem; } code { background: #f4f1ec; padding: 0 .25em; border-radius: 3px; font-size: .92em; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .86rem; }
th, td { padding: .35rem .7rem; border-bottom: 1px solid #e3ddd3; text-align: left; vertical-align: top; }
th { background: #faf6ef; } tbody tr:hover { background: #fdfaf5; }
td code { white-space: nowrap; } small { color: #777; white-space: nowrap; }
figure { margin: 1.5rem 0; } img { max-width: 100%; border: 1px solid #e3ddd3; }
figcaption { font-size: .86rem; color: #555; }
"""


def markdown_page(sections: Sequence[ReportSection], html_name: str) -> str:
    """The report as Markdown; the pictures are in the HTML page of that name beside it."""
    parts = [f"# {TITLE}\n", f"With pictures, as one page for the browser: [{html_name}]({html_name}).\n"]
    for section in sections:
        parts.append(f"## {section.title}\n")
        parts += [_wrapped(paragraph) for paragraph in section.paragraphs]
        if section.columns:
            parts.append(markdown_table(section.columns, section.rows))
    return "\n".join(parts)


def _wrapped(paragraph: str) -> str:
    return textwrap.fill(paragraph, LINE, break_long_words=False, break_on_hyphens=False) + "\n"


def html_page(sections: Sequence[ReportSection], pictures: Sequence[WindowPicture]) -> str:
    """The page as HTML with embedded pictures: no script, no other file."""
    written = [_section(section) for section in sections]
    body = "\n".join([*written[:BEFORE_PICTURES], _figures(pictures), *written[BEFORE_PICTURES:]])
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(TITLE)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(TITLE)}</h1>\n{body}\n</body>\n</html>\n"
    )


def inline_html(text: str) -> str:
    """Text with `code` in backticks as HTML; everything else is text."""
    return re.sub("`([^`]*)`", r"<code>\1</code>", escape(text))


def _section(section: ReportSection) -> str:
    parts = [f"<h2>{inline_html(section.title)}</h2>"]
    parts += [f"<p>{inline_html(paragraph)}</p>" for paragraph in section.paragraphs]
    if section.columns:
        head = "".join(f"<th>{inline_html(column)}</th>" for column in section.columns)
        rows = "\n".join(
            "<tr>" + "".join(f"<td>{_value(value)}</td>" for value in row) + "</tr>" for row in section.rows
        )
        table = f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
        parts.append(f'<div class="wide">{table}</div>')
    return "\n".join(parts)


def _value(text: str) -> str:
    """A cell, its interval on a line of its own."""
    return re.sub(r" (\[[^\]]*\])$", r"<br><small>\1</small>", inline_html(text))


def _figures(pictures: Sequence[WindowPicture]) -> str:
    if not pictures:
        return ""
    parts = [f"<h2>{PICTURES}</h2>", f"<p>{escape(one_line(PICTURE_WORDS))}</p>"]
    for picture in pictures:
        data, words = base64.b64encode(picture.png).decode(), escape(picture.words)
        image = f'<img alt="{words}" src="data:image/png;base64,{data}">'
        parts.append(f"<figure>{image}<figcaption>{words}</figcaption></figure>")
    return "\n".join(parts)
