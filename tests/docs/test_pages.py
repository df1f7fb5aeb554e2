"""Every link of the documentation leads somewhere, and every page is reached."""

import re
from pathlib import Path

import pytest

from docs import make_api_pages
from tests.docs.markdown_pages import DOCS, PAGES, ROOT, Target, anchors_of, targets_of

LONGEST_README = 220


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def problem_with(target: Target) -> str | None:
    """What is wrong with a local link; None if nothing is."""
    if not target.is_local:
        return None
    if not target.path.is_relative_to(ROOT) or not target.path.exists():
        return f"{target.link} is not there"
    if target.anchor and target.anchor not in anchors_of(target.path.read_text(encoding="utf-8")):
        return f"{target.link} has no such heading"
    if DOCS in target.page.parents and not target.path.is_relative_to(DOCS):
        return f"{target.link} leaves docs/, where the site cannot follow"
    return None


def test_every_link_leads_somewhere() -> None:
    targets = [target for page in PAGES for target in targets_of(page)]
    assert len(targets) > 300
    assert [f"{name_of(target.page)}: {problem}" for target in targets if (problem := problem_with(target))] == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[a](nowhere.md)", "is not there"),
        ("![a](images/nothing.png)", "is not there"),
        ("[a\nb](glossary.md#no-such-word)", "has no such heading"),
        ("[a](#nothing)", "has no such heading"),
        ("[a](../../../elsewhere.md)", "is not there"),
        ("[a](../../README.md)", "leaves docs/"),
        ("[![a](nothing.png)](glossary.md)", "is not there"),
        ('<img src="nothing.webp">', "is not there"),
    ],
)
def test_a_broken_link_is_found(text: str, said: str) -> None:
    problems = [problem_with(target) for target in targets_of(DOCS / "use" / "labels.md", text)]
    assert any(problem and said in problem for problem in problems)


def test_what_is_no_link_of_ours_is_left_alone() -> None:
    text = "[a](https://example.org/x) `[b](no.md)`\n\n```\n[c](no.md)\n```\n[d](glossary.md) [e](labels.md#scores)"
    targets = targets_of(DOCS / "use" / "labels.md", text)
    assert len(targets) == 3
    assert [problem_with(target) for target in targets] == [None] * 3


def test_anchors_are_those_of_github() -> None:
    text = "# The `auto` chain: what's new?\n## One\n## One\n```\n# no heading\n```\n### See [this](x.md), too & more\n"
    assert anchors_of(text) == {"the-auto-chain-whats-new", "one", "one-1", "see-this-too--more"}


def reached_from(page: Path) -> set[Path]:
    reached, waiting = set(), [page]
    while waiting:
        here = waiting.pop()
        if here in reached:
            continue
        reached.add(here)
        if here.suffix == ".md":
            waiting += [target.path for target in targets_of(here) if target.is_local]
    return reached


def test_every_file_is_reached_from_the_index_in_one_step_or_on_the_way() -> None:
    files = {path for path in DOCS.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    makers = set(DOCS.glob("*.py"))
    not_linked = {*makers, DOCS / "examples" / "small_input.py", DOCS / "examples" / "rig.toml"}
    assert files - reached_from(DOCS / "index.md") - not_linked == set()
    pages = {path for path in files if path.suffix == ".md"}
    indexes = (DOCS / "index.md", DOCS / "api" / "index.md")  # the second for the reference alone
    assert pages <= {target.path for index in indexes for target in targets_of(index)} | {DOCS / "index.md"}


def test_the_reference_has_a_page_for_every_public_package() -> None:
    texts = make_api_pages.pages()
    assert len(texts) > 10
    assert {path: (ROOT / path).read_text(encoding="utf-8") for path in texts} == texts, "python -m docs.make_api_pages"
    assert {path.relative_to(ROOT) for path in (DOCS / "api").iterdir()} == set(texts)


def test_every_page_is_in_the_menu_of_the_site() -> None:
    menu = re.findall(r"- (?:[\w ]+: )?([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(menu) == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= LONGEST_README
