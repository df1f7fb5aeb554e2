"""The arguments of the verbs that run a detector: the method, its settings, the window."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from app.cli.arguments import PositiveInt, flag
from core.config import load_config
from core.detection import DetectorConfig
from core.detection.methods import FRAME_METHODS, METHODS, Method, method_config, method_named
from core.errors import CommandError

WHAT = "; ".join(f"{name}: {what}" for name, what in METHODS.items())
CONFIG = "detector settings saved in the app, a TOML file"


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodArguments:
    """A detector that works."""

    method: Annotated[Method, method_named] = flag(WHAT, "|".join(METHODS), "auto")
    config: Path | None = flag(CONFIG, "FILE")

    def settings(self) -> DetectorConfig:
        """What the detector runs with; raises RallyscopeError for a bad file."""
        return detector_settings(self.method, self.config)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorArguments:
    """A detector that looks at events, and its window."""

    method: Annotated[Method, method_named] = flag(WHAT, "|".join(METHODS), "auto")
    config: Path | None = flag(CONFIG, "FILE")
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")

    def settings(self) -> tuple[DetectorConfig, int]:
        """What the detector runs with and the length of a window; raises RallyscopeError for a bad file."""
        config = detector_settings(self.method, self.config)
        return config, self.window_us or config.window.window_us


def any_method(name: str) -> str:
    """A method by its name, one that looks at pictures too; raises CommandError for any other name."""
    return name if name in FRAME_METHODS else method_named(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnyMethodArguments:
    """A detector that looks at events or at pictures."""

    method: Annotated[str, any_method] = flag(
        "; ".join(f"{name}: {what}" for name, what in {**METHODS, **FRAME_METHODS}.items()),
        "|".join([*METHODS, *FRAME_METHODS]),
        "auto",
    )
    config: Path | None = flag(CONFIG, "FILE")
    window_us: PositiveInt | None = flag("length of a window of events", "N", "the config's")
    weights: Path | None = flag("of yolo, made by `train-detector`", "FILE", "those that come with the package")

    def settings(self) -> tuple[Method, DetectorConfig, int]:
        """Of a method that looks at events: its name, what it runs with, and the length of a window.

        Raises:
            RallyscopeError: for a bad file, or a flag that it does not have.
        """
        if self.weights is not None:
            raise CommandError(f"{self.method} has no weights", where="--weights", remedy="they go with --method yolo")
        method = method_named(self.method)
        config = detector_settings(method, self.config)
        return method, config, self.window_us or config.window.window_us


def detector_settings(method: Method, file: Path | None) -> DetectorConfig:
    """What a method runs with, by default its own settings.

    Raises:
        RallyscopeError: for a bad file.
    """
    return method_config(method, load_config(DetectorConfig, file) if file else None)
