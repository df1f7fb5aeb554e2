"""Every command that a page, a docstring or a message of the code names is one that we have, with all its flags."""

from __future__ import annotations

import ast
import importlib.util
import re
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from types import ModuleType

import pytest

from app.cli.arguments import read_arguments
from app.cli.bench import BENCHES, OPTIONS, OWN_RECORDINGS, BenchArguments
from app.cli.main import MODULES, VERBS, parse, split_plugins
from core.detection.methods import METHODS
from core.errors import RallyscopeError
from tests.docs.markdown_pages import PAGES, ROOT, Shown, commands_of, commands_of_code

FOLDERS = ("app", "core", "labels", "benchmarks", "docs")
CODE = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py") if "tests" not in path.parts]
LEFT_OUT = re.compile(r"required|expected one argument|(choice:|no method) '(NAME|1)'")
"""What is wrong with a command that prose shortens: `bench NAME`, `import --frames`."""
MODULE = re.compile(r"python -m ((?:app|benchmarks|docs|tests)[\w.]*)((?: \[?--?[a-z][\w-]*| \[?[^\s`]+)*)")


def help_on(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What `--help` prints of a verb, or of its act."""
    with pytest.raises(SystemExit):
        parse([*words, "--help"])
    return capsys.readouterr().out


def module_of(verb: str) -> ModuleType:
    return importlib.import_module(f"app.cli.{MODULES.get(verb, verb)}")


def problem_with(shown: Shown, capsys: pytest.CaptureFixture[str]) -> str | None:
    """What our command line has against a command."""
    plugins, words = split_plugins(shown.words)
    flags = [word for word in words if word.startswith("-")]
    if {"--help", "--version"} & set(flags):
        return None if shown.words[0] in {*flags, *VERBS} else f"{shown.words}: no such verb"
    try:
        arguments = parse(words)
    except RallyscopeError as error:
        if plugins and words[0] in VERBS:
            return None  # the choice or the flag may be the plugin's
        if shown.whole or not LEFT_OUT.search(str(error)):
            return f"{shown.words}: {error}"
        place = list(takewhile(re.compile(r"[a-z][a-z-]*$").match, shown.words))[:2]
        act = place if len(place) == 2 and "ACTS" in vars(module_of(place[0])) else place[:1]
        known = re.findall(r"(?<![\w-])--?[\w-]+", help_on(act, capsys))
        return next((f"{shown.words}: no {flag}" for flag in flags if flag not in known), None)
    return problem_with_bench(read_arguments(BenchArguments, arguments), shown) if arguments.verb == "bench" else None


def problem_with_bench(asked: BenchArguments, shown: Shown) -> str | None:
    """Options that the command line knows, and this bench has not: read from its source, which takes long to load."""
    own = asked.recorded is not None and asked.name in OWN_RECORDINGS
    path = ROOT / "benchmarks" / ((OWN_RECORDINGS if own else BENCHES)[asked.name].replace(".", "/") + ".py")
    source = path.read_text(encoding="utf-8")
    (run,) = (node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef) and node.name == "run")
    taken = {argument.arg for argument in run.args.kwonlyargs}
    unknown = [name for name in OPTIONS if getattr(asked, name) not in (None, False) and name not in taken]
    if unknown:
        return f"{shown.words}: no --{unknown[0]}"
    parts = "".join(file.read_text(encoding="utf-8") for file in path.parent.glob("*.py")) + " ".join(METHODS)
    return f"{shown.words}: no part {asked.only}" if asked.only and asked.only not in parts else None


def problem_with_module(module: str, words: str) -> str | None:
    """What is wrong with a `python -m MODULE`: there is none, or none of its flags."""
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return f"no module {module}"
    source = Path(found.origin).read_text(encoding="utf-8")
    unknown = (flag for flag in re.findall(r"--[a-z][\w-]*", words) if not re.search(rf"{flag}(?![\w-])", source))
    return next((f"{module} has no {flag}" for flag in unknown), None)


def shown_commands() -> Iterator[tuple[str, Shown]]:
    """Every command of pages and code, with the file's name."""
    for page in PAGES:
        if page.name != "CHANGELOG.md":  # the history names what was there then
            for shown in commands_of(page.read_text(encoding="utf-8")):
                yield page.relative_to(ROOT).as_posix(), shown
    for path in CODE:
        for shown in commands_of_code(path.read_text(encoding="utf-8")):
            yield path.relative_to(ROOT).as_posix(), shown


def test_every_command_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    commands = list(dict.fromkeys(shown_commands()))
    assert len(commands) > 250
    assert [f"{name}: {said}" for name, shown in commands if (said := problem_with(shown, capsys))] == []


def test_every_module_that_is_to_be_run_is_there() -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in [*PAGES, *CODE, ROOT / "Makefile"]}
    found = [(path, *match) for path, text in texts.items() for match in MODULE.findall(text)]
    assert len(found) > 15
    assert [f"{path.name}: {said}" for path, *match in found if (said := problem_with_module(*match))] == []
    assert problem_with_module("docs.make_film", " [--second 10]") == "docs.make_film has no --second"
    assert problem_with_module("docs.make_movie", "") == "no module docs.make_movie"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("```\nrallyscope info a.h5 --jsn\n```", "--jsn"),
        ("```\nrallyscope track a.h5\n```", "--out"),
        ("```\n.venv/bin/rallyscope labels scor REC\n```", "scor"),
        ("`rallyscope infos`", "infos"),
        ("`rallyscope labels merge --prefers anna`", "--prefers"),
        ("`rallyscope tune --trial 8`", "--trial"),
        ("`rallyscope export REC\n--rdr F`", "--rdr"),
        ("`bench drift`", "drift"),
        ("`bench rally --count 3`", "--count"),
        ("`bench app --only door`", "door"),
        ("`bench learning --only slow-serves`", "slow-serves"),
    ],
)
def test_a_command_that_we_do_not_have_is_found(text: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    (shown,) = commands_of(text)
    assert said in (problem_with(shown, capsys) or "")


def test_commands_are_found_in_code_and_prose() -> None:
    text = (
        "Try `rallyscope info REC`.\n```\n$ rallyscope detect a.h5 \\\n    --out b.csv   # all\n"
        ".venv/bin/rallyscope info a.h5\nmake run\n```\n`rallyscope bench rally --chain filter|fit [--json]`, "
        "`bench labels`"
    )
    assert [(*shown.words, shown.whole) for shown in commands_of(text)] == [
        ("detect", "a.h5", "--out", "b.csv", True),
        ("info", "a.h5", True),
        ("info", "REC", False),
        ("bench", "rally", "--chain", "filter", "--json", False),
        ("bench", "rally", "--chain", "filter", False),
        ("bench", "labels", False),
    ]
    docstring = '"""Measured by `rallyscope bench rally\n    --balls {balls}`, as `bench labels` does."""'
    assert [shown.words for shown in commands_of_code(docstring)] == [
        ("bench", "rally", "--balls", "1"),
        ("bench", "labels"),
    ]
