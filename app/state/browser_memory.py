"""Stored data of each browser: its detector configs with undo, and the hints it has seen.

The view itself is in the address. A config is kept as its differences from another, in links and here; in its undo a
slider's drag is one step.
"""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from app.shared.workspace import Workspace
from app.state.client_state import Configs, History
from core.config import field_specs, get_setting, replace_setting
from core.detection import DetectorConfig
from core.detection.methods import METHODS, STAGED, UNNAMED_METHOD, Method, method_config, method_named
from core.errors import CommandError, ConfigError
from core.files import replace_file
from core.text import parse_json

logger = logging.getLogger(__name__)


def default_config(method: Method) -> DetectorConfig:
    """Default config of a method in the app."""
    return DetectorConfig() if method in STAGED else method_config(method)


def differing_settings(config: DetectorConfig, base: DetectorConfig) -> dict[str, object]:
    """Settings of `config` that differ from `base`, by their dotted path, as JSON values."""
    found: dict[str, object] = {}
    for spec in field_specs(DetectorConfig):
        value = get_setting(config, spec.path)
        if value != get_setting(base, spec.path):
            found[".".join(spec.path)] = list(value) if isinstance(value, tuple) else value
    return found


def with_settings(base: DetectorConfig, settings: Mapping[str, object]) -> DetectorConfig:
    """`base` with these settings.

    Settings may go together only all at once, so they are tried again after the others until none is left that fits.

    Raises:
        ConfigError: if one is no setting, or out of range, or does not go with the others.
    """
    known = {".".join(spec.path): spec for spec in field_specs(DetectorConfig)}
    left = dict(settings)
    while left:
        problem: ConfigError | None = None
        for name, value in list(left.items()):
            spec = known.get(name)
            if spec is None:
                raise ConfigError("no such setting", expected="one of the detector's", got=name[:80])
            if isinstance(value, list):
                value = tuple(value)
            # JSON of a browser writes 2.0 as 2.
            elif spec.kind is float and isinstance(value, int) and not isinstance(value, bool):
                value = float(value)
            if not isinstance(value, (bool, int, float, str, tuple)):
                raise ConfigError("not a value of a setting", expected="a number, a text or a list", where=name)
            try:
                base = replace_setting(base, spec.path, value)
            except ConfigError as error:
                problem = error
            else:
                del left[name]
                break
        else:
            assert problem is not None
            raise problem
    return base


MAX_STEPS: Final = 50
"""Most steps of undo, and of redo, that are kept."""
MAX_BROWSERS: Final = 500
MAX_FILE_BYTES: Final = 2_000_000
MAX_SEEN: Final = 32
MAX_SEEN_BYTES: Final = 4096
KINDS: Final = ("json", "seen")
"""Kinds of files; one file of each kind per browser."""
_BROWSER: Final = re.compile(r"[0-9a-f]{32}")
STAGED_NAME: Final[Method] = "auto"
"""Key of the configs that the methods with stages share."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """The settings of one browser, and the method that it had chosen."""

    configs: History[Configs]
    own_configs: Mapping[Method, History[Configs]] = field(default_factory=dict)
    method: Method = UNNAMED_METHOD
    """The chosen method."""


class BrowserMemory:
    """Storage of browsers' data in a folder of the workspace; thread-safe."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._lock = threading.Lock()

    def recall(self, browser: str) -> Remembered | None:
        """Stored settings; None for an unknown browser or an unusable file."""
        if not _BROWSER.fullmatch(browser):
            return None
        try:
            path = self._path(browser)
            if not path.is_file() or path.stat().st_size > MAX_FILE_BYTES:
                return None
            return _decode(parse_json(path.read_bytes()))
        except (OSError, ValueError, TypeError, KeyError, RecursionError, CommandError, ConfigError) as error:
            logger.warning("the settings of a browser cannot be read again: %s", error)
            return None

    def keep(self, browser: str, remembered: Remembered) -> None:
        """Store settings; nothing is stored for a browser without a cookie."""
        if not _BROWSER.fullmatch(browser):
            return
        data = json.dumps(_encode(remembered), separators=(",", ":")).encode()
        with self._lock:
            try:
                replace_file(self._path(browser), data, durable=False)
                self._forget_the_oldest(browser)
            except (OSError, CommandError) as error:
                logger.warning("the settings of a browser are not kept: %s", error)

    def knows(self, browser: str) -> bool:
        """Whether anything is stored for this browser."""
        try:
            return bool(_BROWSER.fullmatch(browser)) and any(self._path(browser, kind).is_file() for kind in KINDS)
        except (OSError, CommandError):
            return False

    def seen(self, browser: str) -> frozenset[str]:
        """Names of the hints it has seen."""
        if not _BROWSER.fullmatch(browser):
            return frozenset()
        try:
            with self._path(browser, "seen").open("rb") as file:
                lines = file.read(MAX_FILE_BYTES).decode("utf-8", "replace").splitlines()
                return frozenset([line for line in lines if line][:MAX_SEEN])
        except (OSError, CommandError):
            return frozenset()

    def note_seen(self, browser: str, what: str) -> None:
        """Store that it has seen a hint."""
        if not _BROWSER.fullmatch(browser):
            return
        with self._lock:
            known = self.seen(browser)
            try:
                if what not in known:
                    with self._path(browser, "seen").open("ab") as file:  # merged with what another server has written
                        if file.tell() > MAX_SEEN_BYTES:
                            file.truncate(0)
                        file.write(f"\n{what}\n".encode())
                    self._forget_the_oldest(browser)
            except (OSError, CommandError) as error:
                logger.warning("what a browser has seen is not kept: %s", error)

    def _path(self, browser: str, kind: str = KINDS[0]) -> Path:
        return self._workspace.browsers / f"{browser}.{kind}"

    def _forget_the_oldest(self, browser: str) -> None:
        """Keep `MAX_BROWSERS` browsers, this one among them: times of files are coarse, and clocks are set back."""
        for kind in KINDS:
            files = list(self._workspace.browsers.glob(f"*.{kind}"))
            if len(files) > MAX_BROWSERS:
                others = sorted((path for path in files if path.stem != browser), key=lambda path: path.stat().st_mtime)
                for path in others[: len(files) - MAX_BROWSERS]:
                    path.unlink(missing_ok=True)


def _encode(remembered: Remembered) -> dict[str, object]:
    histories: dict[Method, History[Configs]] = {STAGED_NAME: remembered.configs, **remembered.own_configs}
    methods = {method: _encode_history(method, one) for method, one in histories.items()}
    return {"version": 1, "method": remembered.method, "methods": methods}


def _encode_history(method: Method, history: History[Configs]) -> dict[str, object]:
    def pair(configs: Configs) -> list[dict[str, object]]:
        base = default_config(method)
        return [differing_settings(configs.a, base), differing_settings(configs.b, base)]

    return {
        "present": pair(history.present),
        "past": [pair(one) for one in history.past[-MAX_STEPS:]],
        "future": [pair(one) for one in history.future[:MAX_STEPS]],
    }


def _decode(content: Mapping) -> Remembered:
    if content["version"] != 1:
        raise ValueError("of another version")
    methods = content["methods"]
    known: dict[Method, History[Configs]] = {
        method: _decode_history(method, methods[method]) for method in METHODS if method in methods
    }
    configs = known.pop(STAGED_NAME)
    own_configs: dict[Method, History[Configs]] = {method: one for method, one in known.items() if method not in STAGED}
    chosen = content.get("method", UNNAMED_METHOD)
    return Remembered(configs, own_configs, method_named(chosen) if chosen in METHODS else UNNAMED_METHOD)


def _decode_history(method: Method, content: Mapping) -> History[Configs]:
    def pair(two: list) -> Configs:
        base = default_config(method)
        a, b = two
        return Configs(with_settings(base, a), with_settings(base, b))

    past, future = content["past"][-MAX_STEPS:], content["future"][:MAX_STEPS]
    return History(pair(content["present"]), tuple(map(pair, past)), tuple(map(pair, future)))
