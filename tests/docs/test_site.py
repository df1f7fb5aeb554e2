"""The site of the documentation is built without a complaint, and needs no other machine."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("zensical", reason="the extra `docs` is not installed")
    pytest.importorskip("mkdocstrings_handlers.python", reason="the extra `docs` is not installed")
    folder = tmp_path_factory.mktemp("site")
    for part in ("core", "labels"):
        (folder / part).symlink_to(ROOT / part, target_is_directory=True)
    shutil.copy(ROOT / "mkdocs.yml", folder)
    shutil.copytree(ROOT / "docs", folder / "docs", ignore=shutil.ignore_patterns("__pycache__"))
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict", "--clean"],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "No issues found" in done.stdout + done.stderr
    return folder / "build" / "docs"


def test_every_page_is_in_the_site_with_its_pictures(site: Path) -> None:
    for page in (ROOT / "docs").rglob("*.md"):
        place = page.relative_to(ROOT / "docs").with_suffix("")
        assert (site / ("index.html" if place.name == "index" else place / "index.html")).is_file(), page
    assert (site / "measured" / "perception-report.html").is_file()
    for page in site.rglob("index.html"):
        for source in re.findall(r'<img[^>]*\bsrc="?([^" >]+)', page.read_text(encoding="utf-8")):
            assert (page.parent / source).resolve().is_file(), (page, source)


def test_the_reference_is_made_from_the_docstrings(site: Path) -> None:
    page = (site / "api" / "core-detection" / "index.html").read_text(encoding="utf-8")
    assert 'id="core.detection.make_detector"' in page and 'id="core.detection.Detection"' in page


def test_nothing_is_loaded_from_another_machine(site: Path) -> None:
    loads = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*?\b(?:src|href)=\"?(?:https?:)?//[^\" >]+")
    pages = list(site.rglob("index.html"))
    assert len(pages) > 25
    for page in pages:
        assert loads.findall(page.read_text(encoding="utf-8")) == [], page
    for style in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import\s+)[\"']?(?:https?:)?//", style.read_text(encoding="utf-8")), style
