"""The arguments of the verbs that run a detector: the method, its settings, the window."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from app.cli.arguments import PositiveInt, flag
from core.detection import DetectorConfig
from core.detection.methods import DEFAULT_METHOD, FRAME_METHODS, METHODS, Method, method_config, method_named
from core.detection.saved import SavedDetector, load_detector
from core.errors import CommandError

WHAT = "; ".join(f"{name}: {what}" for name, what in METHODS.items())
CONFIG = "detector settings saved in the app, a TOML file"
DEFAULT = f"{DEFAULT_METHOD}; with --config the file's"
"""What runs where no method is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodArguments:
    """A detector that works."""

    method: Annotated[Method, method_named] | None = flag(WHAT, "|".join(METHODS), DEFAULT)
    config: Path | None = flag(CONFIG, "FILE")

    def settings(self) -> SavedDetector:
        """The method and what it runs with; raises RallyscopeError for a bad file."""
        return chosen_detector(self.method, self.config)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorArguments:
    """A detector that looks at events, and its window."""

    method: Annotated[Method, method_named] | None = flag(WHAT, "|".join(METHODS), DEFAULT)
    config: Path | None = flag(CONFIG, "FILE")
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")

    def settings(self) -> tuple[Method, DetectorConfig, int]:
        """The method, what it runs with and the length of a window; raises RallyscopeError for a bad file."""
        method, config = chosen_detector(self.method, self.config)
        return method, config, self.window_us or config.window.window_us


def any_method(name: str) -> str:
    """A method by its name, one that looks at pictures too; raises CommandError for any other name."""
    return name if name in FRAME_METHODS else method_named(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnyMethodArguments:
    """A detector that looks at events or at pictures."""

    method: Annotated[str, any_method] | None = flag(
        "; ".join(f"{name}: {what}" for name, what in {**METHODS, **FRAME_METHODS}.items()),
        "|".join([*METHODS, *FRAME_METHODS]),
        DEFAULT,
    )
    config: Path | None = flag(CONFIG, "FILE")
    window_us: PositiveInt | None = flag("length of a window of events", "N", "the config's")
    weights: Path | None = flag("weights of yolo, made by `train-detector`", "FILE", "those that come with the package")

    @property
    def frame_method(self) -> str | None:
        """The method, if it looks at pictures."""
        return self.method if self.method in FRAME_METHODS else None

    def settings(self) -> tuple[Method, DetectorConfig, int]:
        """Name, config and window length of an event-based method.

        Raises:
            RallyscopeError: for a bad file, or a flag that it does not have.
        """
        method, config = chosen_detector(None if self.method is None else method_named(self.method), self.config)
        if self.weights is not None:
            raise CommandError(f"{method} has no weights", where="--weights", remedy="they go with --method yolo")
        return method, config, self.window_us or config.window.window_us


def chosen_detector(method: Method | None, file: Path | None) -> SavedDetector:
    """What runs: the method that is named, else the file's, else the default; with the file's settings or its own.

    Raises:
        RallyscopeError: for a bad file.
    """
    if file is None:
        method = method or DEFAULT_METHOD
        return SavedDetector(method, method_config(method))
    saved = load_detector(file)
    method = method or saved.method
    return SavedDetector(method, method_config(method, saved.config))
