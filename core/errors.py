"""Errors that a user can act on. Anything else that escapes is a bug."""

from __future__ import annotations

from typing import Final

from core.text import plain

WRITE_REMEDY: Final = "free some space, or choose a folder that can be written"
"""What to do where a file cannot be written."""
LONGEST_FACT: Final = 600
"""Characters of what was expected, or got, in a message."""
LONGEST_PART: Final = 2000
"""Most characters of one part of a message: what was got may be a whole file."""


class RallyscopeError(Exception):
    """Something the user gave cannot be used; the message is one line that says what, where, and what to do.

    The command line prints the message and exits with 2; the app shows it as a notification.
    """

    def __init__(
        self,
        what: str,
        *,
        expected: object = None,
        got: object = None,
        where: object = None,
        remedy: str | None = None,
    ) -> None:
        given = {"expected": expected, "got": got}
        facts = [f"{name} {_short(value)}" for name, value in given.items() if value is not None]
        rest = [part for part in (", ".join(facts), remedy) if part]
        super().__init__(_one_line([what if where is None else f"{_bounded(where)}: {what}", *rest]))
        self.what = _one_line([what])
        """What did not work."""
        self.details = _one_line([*([] if where is None else [_bounded(where)]), *rest])
        """Where, why, and what to do; may be empty."""


def _short(value: object) -> str:
    """A damaged file may hold a value of any length."""
    text = str(value)
    return text if len(text) <= LONGEST_FACT else f"{text[:LONGEST_FACT]}..."


def _one_line(parts: list[str]) -> str:
    return plain(" ".join("; ".join(map(_bounded, parts)).split()), None)


def _bounded(value: object) -> str:
    text = str(value)
    return text if len(text) <= LONGEST_PART else f"{text[:LONGEST_PART]} ..."


class EventsError(RallyscopeError):
    """Event columns that are not a valid sorted stream."""


class RecordingError(RallyscopeError):
    """A recording or an event file that cannot be read or written."""


class CalibrationError(RallyscopeError):
    """A camera calibration that is missing, malformed or impossible."""


class LabelError(RallyscopeError):
    """A label, a label store or a label file that cannot be used."""


class ConfigError(RallyscopeError):
    """A configuration value or file that is out of range, unknown or malformed."""


class AgentError(RallyscopeError):
    """An agent whose action, or a reward whose value, is no number."""


class CommandError(RallyscopeError):
    """A command line that asks for something impossible."""


class PluginError(RallyscopeError):
    """Code of others, a file or an installed package, that cannot be loaded or registers what does not fit."""


class JobsError(RallyscopeError):
    """A cluster that cannot be used or is gone, or a piece of work whose workers keep dying."""


class PackageError(RallyscopeError):
    """A package that this installation lacks, or whose version does not fit."""


class DeviceError(RallyscopeError):
    """An event camera that is not there, cannot be opened or read, or does not do what it is asked."""


class LinkError(RallyscopeError):
    """A message of the simulation link that is malformed or out of bounds, or a server that does not answer."""


class NoAnswerError(LinkError):
    """Nobody answered in time."""


class RefusedError(LinkError):
    """A server that is there and does not know our key, or is not the one whose key we know."""


class TargetRefusedError(LinkError):
    """A racket target that is not let out to a robot, or that the robot does not take; `why` is one word for it."""

    def __init__(self, why: str, what: str, *, where: object = None) -> None:
        super().__init__(what, where=where)
        self.why = why


class NotReadyError(LinkError):
    """A server that is there but still being prepared; `share` of that is done, 0 to 1."""

    def __init__(self, what: str, *, share: float, where: object = None) -> None:
        super().__init__(what, where=where)
        self.share = share
