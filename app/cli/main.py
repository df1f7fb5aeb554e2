"""The entry point: finds the verb, runs it, and turns its end into an exit code (0, 2 for bad input, 1 for a bug)."""

from __future__ import annotations

import argparse
import importlib
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

from app.cli.arguments import Parser, add_verb, arguments_of, name_the_flag
from app.cli.terminal import PlainFormatter, output_was_lost, prepare_streams, say
from core.errors import CommandError, ConfigError, RallyscopeError
from core.extras import missing_package
from core.registry import use_plugins

VERBS = {
    "serve": "open the app in a browser",
    "import": "convert event files of one camera or more to a recording",
    "info": "show what a recording holds",
    "simulate": "make a recording with the simulated event cameras",
    "sim-server": "run the live simulation as its own process",
    "record": "record event cameras, or a replay, into a file",
    "detect": "find the ball in every window of a recording",
    "track": "triangulate the ball in 3D",
    "predict": "predict a flight from its first points",
    "train": "train a policy",
    "evaluate": "evaluate a trained policy",
    "bench": "measure speed and quality",
    "calibrate": "calibrate the cameras",
    "fit-physics": "fit the flight model to real flights",
    "tune": "search for better detection parameters",
    "train-detector": "train a detector that learns from pictures",
    "labels": "import, export, score and merge labels",
    "export": "write a recording for other tools",
}
MODULES = {
    "import": "import_",
    "fit-physics": "fit_physics",
    "sim-server": "sim_server",
    "train-detector": "train_detector",
}
"""Verbs whose module has another name than the verb. A module has `run(arguments: ItsArguments)`, or several such
functions by the names of its sub-verbs in `ACTS`."""
PRINTING_VERBS = ("info", "evaluate", "predict")
PLUGIN_FLAG = "--plugin"
PLUGIN_HELP = (
    "Python file to run at the start; it adds detectors, readers, label formats, exporters or rewards; repeat for more"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    prepare_streams()
    if argv is None:
        # A process of our own, and all that it starts, by multiprocessing too, imports nothing from the working folder.
        os.environ.setdefault("PYTHONSAFEPATH", "1")
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        code = _run(arguments)
        return 2 if output_was_lost() and _prints_its_result(arguments) else code
    except RallyscopeError as error:
        say(f"rallyscope: {error}", error=True)
        return 2
    except MemoryError as error:
        say(f"rallyscope: not enough memory for this much at once; {str(error)[:200] or 'ask for less'}", error=True)
        return 2
    except KeyboardInterrupt:
        say("rallyscope: stopped", error=True)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:  # noqa: BLE001 (the last resort: it is shown whole, and called a bug)
        if (missing := missing_package(error)) is not None:
            say(f"rallyscope: {missing}", error=True)
            return 2
        say(traceback.format_exc().rstrip(), error=True)
        say("rallyscope: this is a bug; the lines above say where", error=True)
        return 1


def _prints_its_result(words: Sequence[str]) -> bool:
    """Whether nothing is left of the work once what it prints is lost."""
    verb = next((word for word in words if not word.startswith("-")), "")
    return verb in PRINTING_VERBS or bool({"--json", "--check"}.intersection(words))


def _run(argv: list[str]) -> int:
    plugins, words = split_plugins(argv)
    use_plugins(plugins)  # first: they add choices to the verbs' arguments
    arguments = parse(words)
    handler = logging.StreamHandler()
    handler.setFormatter(PlainFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        arguments.run(arguments)
    except ConfigError as error:
        named = name_the_flag(error, words)
        if named is error:
            raise
        raise named from error
    return 0


def split_plugins(argv: Sequence[str]) -> tuple[list[Path], list[str]]:
    """The files of `--plugin FILE`, wherever they stand, and the other words.

    Raises:
        CommandError: for one without a file.
    """
    plugins, words, left = list[Path](), list[str](), list(argv)
    while left:
        word = left.pop(0)
        if word == "--":
            return plugins, [*words, word, *left]
        if word != PLUGIN_FLAG and not word.startswith(f"{PLUGIN_FLAG}="):
            words.append(word)
            continue
        file = word.partition("=")[2] or (left.pop(0) if left and not left[0].startswith("-") else "")
        if not file:
            raise CommandError(f"{PLUGIN_FLAG} without a file", expected=f"{PLUGIN_FLAG} FILE.py")
        plugins.append(Path(file))
    return plugins, words


def _add_verb(parser: argparse.ArgumentParser, run: Callable[..., None]) -> None:
    """The arguments of a verb, and those that all verbs have."""
    add_verb(parser, run)

    def is_abbreviated(word: str) -> NoReturn:
        raise argparse.ArgumentTypeError(f"write {PLUGIN_FLAG} in full")

    parser.add_argument(PLUGIN_FLAG, metavar="FILE.py", type=is_abbreviated, help=PLUGIN_HELP)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Read a command line, without doing anything yet: the result's `run`, given the result, carries it out.

    Raises:
        CommandError: if it is not one of ours.
    """
    parser = Parser(prog="rallyscope", description="An interactive lab for event-camera table tennis.")
    parser.add_argument("--version", action="version", version=f"rallyscope {version('rallyscope')}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    chosen = next((word for word in argv if not word.startswith("-")), None)
    for verb, summary in VERBS.items():
        child = verbs.add_parser(verb, help=summary, description=summary)
        if verb == chosen:  # only the chosen verb's module is imported: `rallyscope info` need not load the app
            module = importlib.import_module(f"app.cli.{MODULES.get(verb, verb)}")
            acts = getattr(module, "ACTS", None)
            if acts is None:
                _add_verb(child, module.run)
                continue
            sub_verbs = child.add_subparsers(dest="act", required=True, metavar="|".join(acts))
            for name, run in acts.items():
                _add_verb(sub_verbs.add_parser(name, help=arguments_of(run).__doc__), run)
    return parser.parse_args(argv)
