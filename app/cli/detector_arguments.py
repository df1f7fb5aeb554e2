"""The arguments of the verbs that run a detector: the method, its settings, the window."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli.arguments import positive_int
from core.config import load_config
from core.detection import DetectorConfig
from core.detection.methods import METHODS, PLANNED, method_config
from core.errors import CommandError


def add_detector_arguments(parser: argparse.ArgumentParser, columns: str) -> None:
    """Method, config, window, and the CSV with these columns."""
    methods = "; ".join(f"{name}: {what}" for name, what in METHODS.items())
    parser.add_argument(
        "--method", default="auto", metavar="|".join([*METHODS, *PLANNED]), help=f"{methods} (default: %(default)s)"
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="detector settings saved in the app, a TOML file")
    parser.add_argument(
        "--window-us", type=positive_int, metavar="N", help="length of a window (default: the config's)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="CSV", help=f"columns {columns}")
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def detector_of(arguments: argparse.Namespace) -> tuple[DetectorConfig, int]:
    """The settings and the length of a window in microseconds, once the place of the CSV has been checked.

    Raises:
        RallyscopeError: for an unknown method, a bad config or a folder that is not there.
    """
    loaded = load_config(DetectorConfig, arguments.config) if arguments.config else None
    config = method_config(arguments.method, loaded)
    if not arguments.out.parent.is_dir():
        raise CommandError("no such folder", got=arguments.out.parent, where="--out")
    return config, arguments.window_us or config.window.window_us
