"""`rallyscope calibrate intrinsics|stereo`: lenses from pictures of a board, poses and clocks from a swept ball."""

from __future__ import annotations

import argparse

from app.cli import calibrate_intrinsics, calibrate_stereo

ACTS = {"intrinsics": calibrate_intrinsics, "stereo": calibrate_stereo}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    acts = parser.add_subparsers(dest="act", required=True, metavar="|".join(ACTS))
    for name, module in ACTS.items():
        module.add_arguments(acts.add_parser(name, help=module.SUMMARY, description=module.SUMMARY))


def run(arguments: argparse.Namespace) -> None:
    """Do what the sub-verb says."""
    ACTS[arguments.act].run(arguments)
