"""Argument parsing that answers a bad argument with one clear line."""

from __future__ import annotations

import argparse
from typing import NoReturn

from core.errors import CommandError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises instead of printing usage; sub-parsers are of this class too."""

    def error(self, message: str) -> NoReturn:
        raise CommandError(message, where=self.prog, remedy=f"see `{self.prog} --help`")


def positive_int(text: str) -> int:
    """A whole number above 0."""
    value = int(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a whole number above 0, got {text!r}")
    return value
