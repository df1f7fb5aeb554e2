"""Files whose every name, note and message wants to be more than text: markup, escapes, megabytes, reversed words."""

from __future__ import annotations

import ast
import json
import logging
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.cli.terminal import PlainFormatter, print_lines, say
from app.export.exporter import ExportedFile, ExportState
from app.formatting import html_text, notice_of
from app.modes.export.files_panel import files_html, state_html
from app.modes.train.side_panel import curve_legend_html
from app.modes.train.status import log_html, runs_html, status_html
from app.modes.tune.auto_run import SidesFigures, TuningReport, report_html
from app.modes.tune.compare_run import CompareAnswer, comparison_html
from app.panels.recording_info import gather_info, health_html
from app.shared.library import Library
from app.shared.trainer import RunState
from app.shared.workspace import Workspace
from app.startup.panel import card_html
from app.startup.startup import Step
from core.cameras import load_calibration
from core.config import load_config
from core.detection import DetectorConfig
from core.errors import RallyscopeError, RecordingError
from core.learning.config import RunConfig
from core.text import LONGEST, plain
from core.tuning.objective import Figures
from tests.app.hostile_recording import HOSTILE, write_hostile_recording

HUGE = HOSTILE + "A" * 10_000_000
UNFIT = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ufeff]")
APP = Path(__file__).parents[2] / "app"


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag, attrs):
        self.found.add(tag)
        self.found |= {name for name, value in attrs if name.startswith("on")}


def assert_harmless_html(text: str, most: int = 60_000) -> None:
    tags = Tags()
    tags.feed(text)
    assert not {"script", "img", "onerror", "onload"} & tags.found, sorted(tags.found)
    assert "pwned" in text, "the hostile text is not shown at all: this proves nothing"
    assert not UNFIT.search(text) and len(text) < most


def assert_harmless_lines(text: str, most: int = 25_000) -> None:
    assert text and not UNFIT.search(text), repr(UNFIT.findall(text)[:3])
    assert len(text) < most


@pytest.mark.parametrize("text", [HOSTILE, HUGE], ids=["hostile", "huge"])
def test_text_from_a_file_is_text(text: str) -> None:
    shown = plain(text)
    assert len(shown) < 3 * LONGEST and "\\x1b[2J" in shown and "\\u202e" in shown and not UNFIT.search(shown)
    assert "\n" not in shown
    assert_harmless_html(f"<td title='{html_text(text)}'>{html_text(text)}</td>")
    assert plain("Größe 2 µm, 球, naïve 🏓") == "Größe 2 µm, 球, naïve 🏓"
    assert plain("\udce9") == "\\udce9"  # a file's name that is no UTF-8


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "rec.h5"
    write_hostile_recording(path)
    return path


def test_a_recording_shows_its_names_and_notes_as_text(recording: Path, tmp_path: Path, capsys) -> None:
    workspace = Workspace(tmp_path / "data")
    place = workspace.recording_path("hostile")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(recording.read_bytes())
    library = Library(workspace)
    try:
        assert_harmless_html(health_html(gather_info(library, "hostile")))
    finally:
        library.close()
    assert main(["info", str(recording)]) == 0
    out = capsys.readouterr().out
    assert_harmless_lines(out)
    assert "pwned" in out and max(map(len, out.split("\n"))) < 2100
    assert not [line for line in out.split("\n") if line.startswith(("\u202e", "gpj"))]
    assert main(["info", str(recording), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"][0] == " ".join(HOSTILE.split())  # in one line, else as it is


@pytest.mark.parametrize("verb", [["detect"], ["track"], ["labels", "score"]])
def test_verbs_on_it_end_in_one_harmless_line(recording: Path, verb: list[str], tmp_path: Path, capsys) -> None:
    words = {"detect": ["--out", str(tmp_path / "o.csv"), "--camera", HOSTILE], "track": ["--out", str(tmp_path / "o")]}
    more = words.get(verb[0], ["--camera", HOSTILE, "--data", str(tmp_path)])
    assert main([*verb, str(recording), *more]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert_harmless_lines(error)


def test_a_config_with_hostile_keys_and_values_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    for text in (f"{json.dumps(HOSTILE)} = 1", f"window_us = {json.dumps(HUGE)}", HOSTILE, HUGE):
        path.write_text(text)
        with pytest.raises(RallyscopeError) as caught:
            load_config(DetectorConfig, path)
        assert "\n" not in str(caught.value)
        for said in (str(caught.value), *notice_of(caught.value)):
            assert_harmless_lines(said, most=10_000)


@pytest.mark.parametrize("head", ["format = 'rallyscope-calibration'\nversion = 1\n[cameras.%s]\nx = 1", "%s: {a: 1}"])
def test_a_calibration_with_hostile_names_is_one_line(tmp_path: Path, head: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(head % json.dumps(HOSTILE))
    with pytest.raises(RallyscopeError) as caught:
        load_calibration(path)
    assert "\n" not in str(caught.value)
    assert_harmless_lines(str(caught.value))


@pytest.mark.parametrize(("format_", "name", "text"), [
    ("coco", "c.json", json.dumps({"images": HOSTILE})),
    ("coco", "c.json", json.dumps({"images": [{"id": 1, "file_name": HOSTILE}], "annotations": [{"id": HOSTILE}]})),
    ("csv", "c.csv", f"{HOSTILE}\n1,2"),
    ("csv", "c.csv", "t_us,state\n1," + HOSTILE.replace("\n", "").replace("\r", "")),
    ("voc", "c.xml", "<annotation><folder>&lt;script&gt;</folder><filename>\u202e</filename></annotation>"),
    ("cvat", "c.xml", "<annotations><image id='0' name='&#x202e;&lt;script&gt;' width='1' height='1'/></annotations>"),
])  # fmt: skip
def test_label_files_with_hostile_texts_end_in_harmless_lines(
    recording: Path, tmp_path: Path, capsys, format_: str, name: str, text: str
) -> None:
    (tmp_path / name).write_text(text)
    words = [tmp_path / name, recording, "--camera", "right", "--data", tmp_path / "data", "--format", format_]
    main(["labels", "import", *map(str, words), "--annotator", "anna"])
    out, err = capsys.readouterr()
    assert_harmless_lines(out + err)
    assert "bug" not in err


@pytest.mark.parametrize("text", [HOSTILE, HUGE], ids=["hostile", "huge"])
def test_every_panel_shows_hostile_names_as_text(text: str) -> None:
    config = RunConfig()
    run = RunState(text, config, "failed", None, None, 0.0, message=text)
    other = RunState(text + "2", config, "running", None, None, 0.0)
    figures = Figures(precision=1.0, recall=1.0, median_error_px=1.0, objective=1.0, balls=1)
    sides = SidesFigures(figures, figures)
    tuned = TuningReport(sides, sides, 1, 1, False, {text: (text, text)}, {text: 1.0})
    compared = CompareAnswer(text, text, "labels", text, False, np.arange(3.0), ())
    for shown in (
        status_html(run, None, other),
        runs_html((run, other), {}),
        log_html((text, text), None),
        curve_legend_html(text, (text,), several_seeds=True),
        files_html((ExportedFile(text, 1, 0.0),)),
        state_html(ExportState(text, True, 0.1, 1.0, "", False)),
        state_html(ExportState("a", False, 1.0, 1.0, text, True)),
        card_html((Step(text, text, state="running"), Step(text, problem=text, state="failed"))),
        report_html(text, tuned),
        comparison_html(compared),
    ):
        assert_harmless_html(shown)


def test_what_is_said_on_a_terminal_holds_no_control_characters(capsys) -> None:
    say(HOSTILE)
    say(HOSTILE, error=True)
    print_lines([HOSTILE, HUGE])
    out, err = capsys.readouterr()
    assert_harmless_lines(out)
    assert_harmless_lines(err)
    assert out.count("\n") == 4  # our own text may have lines; each of the others is one
    record = logging.LogRecord("x", logging.ERROR, "p", 1, "%s", (HUGE,), None)
    assert_harmless_lines(PlainFormatter("%(message)s").format(record))


def test_an_error_is_one_bounded_line_whatever_it_holds() -> None:
    error = RecordingError(HUGE, expected=HUGE, got=HUGE, where=HUGE, remedy="do this")
    for text in (str(error), error.what, error.details, *notice_of(error)):
        assert "\n" not in text
        assert_harmless_lines(text)
    assert str(error).endswith("do this")


def test_there_is_one_place_that_escapes_and_one_that_prints() -> None:
    for path in APP.rglob("*.py"):
        tree = ast.parse(path.read_text())
        called = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
        if path != APP / "formatting.py":
            assert not {"html.escape", "escape"} & called, f"{path}: html_text is for that"
        if path.parent.name == "cli" and path.name != "terminal.py":
            assert not {"print", "traceback.print_exc"} & called, f"{path}: say is for that"


def test_markdown_is_only_our_own_words() -> None:
    for path in APP.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(".add_markdown"):
                assert all(isinstance(word, ast.Constant) for word in node.args), f"{path}:{node.lineno}"
