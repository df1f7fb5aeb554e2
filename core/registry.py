"""What can be added from outside, by name: detectors, readers, label formats, exporters, rewards and agents.

A `Registry` holds the things of one kind. Ours are registered by the modules that make them. Others are found when a
registry is first asked for something that it does not have yet, or for all that it has:

- in Python files that the environment variable RALLYSCOPE_PLUGINS names; `--plugin FILE` of the command line puts them
  there, so that every process that a verb starts finds them too;
- as entry points of installed packages, in the group of the registry.

Both are code that runs with all rights of the user who names or installs it.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import re
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from core.errors import PluginError, RallyscopeError

T = TypeVar("T")
V = TypeVar("V")
PLUGINS_VARIABLE: Final = "RALLYSCOPE_PLUGINS"
"""Environment variable with the plugin files, as PATH has folders."""
MODULE_PREFIX: Final = "rallyscope_plugin_"
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_LOCK: Final = threading.RLock()


@dataclasses.dataclass(slots=True)
class _Loaded:
    """What was loaded in this process."""

    files: dict[Path, str] = dataclasses.field(default_factory=dict)
    """Plugin file -> hash of its content; also while it is being loaded."""
    entry_points: set[tuple[str, str, str]] = dataclasses.field(default_factory=set)
    registered: int = 0
    """How often something was registered."""


_loaded = _Loaded()
_registries: Final[list[Registry[Any]]] = []


class Registry(Mapping[str, T]):
    """The things of one kind by name: ours first, then those of plugin files, then those of installed packages."""

    def __init__(self, kind: str, group: str) -> None:
        """`kind` is what one is called in messages; `group` is the group of entry points."""
        self.kind, self.group = kind, group
        self._items: dict[str, T] = {}
        self._complete = self._searching = False
        self._built_in: frozenset[str] = frozenset()
        _registries.append(self)

    def register(self, name: str, item: T) -> T:
        """Add a thing and return it.

        Raises:
            PluginError: if the name is taken, or no name.
        """
        with _LOCK:
            if not isinstance(name, str) or not _NAME.fullmatch(name):
                expected = "small letters, digits and hyphens, at most 40"
                raise PluginError(f"not a name of a {self.kind}", expected=expected, got=repr(name))
            if name in self._items:
                raise PluginError(f"there is a {self.kind} {name!r} already", remedy="register it by another name")
            self._items[name] = item
            _loaded.registered += 1
        return item

    def mark_built_in(self) -> None:
        """What is registered so far is ours; the module that registers ours calls this at its end."""
        self._built_in = frozenset(self._items)

    def is_built_in(self, name: str) -> bool:
        """Whether it is one of ours."""
        return name in self._built_in

    def registered(self) -> dict[str, T]:
        """What is registered so far, without looking for more: for modules that are being imported."""
        return dict(self._items)

    def complete(self) -> dict[str, T]:
        """All there are: plugin files and entry points are loaded first, once.

        Raises:
            PluginError: if one of them cannot be loaded.
        """
        with _LOCK:
            if not self._complete and not self._searching:
                self._searching = True
                try:
                    load_plugin_files()
                    _load_entry_points(self.group)
                    self._complete = True
                finally:
                    self._searching = False
            return dict(self._items)

    def keep_only(self, names: Collection[str]) -> None:
        """Forget all but these and ours."""
        self._items = {name: item for name, item in self._items.items() if name in names or name in self._built_in}

    def view(
        self,
        value: Callable[[T], V],
        *,
        where: Callable[[T], bool] = lambda item: True,
        key: Callable[[str], str] = lambda name: name,
    ) -> Mapping[str, V]:
        """A part of each thing by name, or by a key made of the name; what is registered later is in it, too."""
        return _View(self, value, where, key)

    def __getitem__(self, name: str) -> T:
        items = self._items if name in self._items else self.complete()
        return items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.complete())

    def __len__(self) -> int:
        return len(self.complete())


class _View(Mapping[str, V], Generic[T, V]):
    def __init__(
        self,
        registry: Registry[T],
        value: Callable[[T], V],
        where: Callable[[T], bool],
        key: Callable[[str], str],
    ) -> None:
        self._registry, self._value, self._where, self._key = registry, value, where, key

    def _find(self, items: Mapping[str, T]) -> dict[str, T]:
        return {self._key(name): item for name, item in items.items() if self._where(item)}

    def __getitem__(self, key: str) -> V:
        found = self._find(self._registry.registered())
        if key not in found:
            found = self._find(self._registry.complete())
        return self._value(found[key])

    def __iter__(self) -> Iterator[str]:
        return iter(self._find(self._registry.complete()))

    def __len__(self) -> int:
        return len(self._find(self._registry.complete()))


def use_plugins(paths: Iterable[Path]) -> None:
    """Load plugin files here, and in every process that this one starts from now on.

    Raises:
        PluginError: if one cannot be loaded.
    """
    named = dict.fromkeys([*plugin_files(), *(path.absolute() for path in paths)])
    for path in named:
        if os.pathsep in str(path):
            raise PluginError(f"a plugin's path cannot hold {os.pathsep!r}", where=path, remedy="rename the folder")
        load_plugin(path)
    if named:
        os.environ[PLUGINS_VARIABLE] = os.pathsep.join(map(str, named))


def plugin_files() -> tuple[Path, ...]:
    """The plugin files that the environment names."""
    words = os.environ.get(PLUGINS_VARIABLE, "").split(os.pathsep)
    return tuple(dict.fromkeys(Path(word).absolute() for word in words if word))


def plugin_hashes() -> dict[str, str]:
    """Path -> hash of its content of each plugin file in use: for workers elsewhere, which are to have the same."""
    return {str(path): _loaded.files[path] for path in plugin_files() if path in _loaded.files}


def load_plugin_files() -> None:
    """Load the plugin files that the environment names; those that are loaded already are not loaded again.

    Raises:
        PluginError: if one cannot be loaded.
    """
    for path in plugin_files():
        load_plugin(path)


def load_same_plugins(hashes: Mapping[str, str]) -> None:
    """In a worker on another machine: load the files that `plugin_hashes` gave there.

    Raises:
        PluginError: if one cannot be loaded, or is another one than there.
    """
    for path, expected in hashes.items():
        load_plugin(Path(path))
        if _loaded.files.get(Path(path)) != expected:
            remedy = "let all machines see the same file, and start the workers again after it was changed"
            raise PluginError("a worker has another version of this plugin", where=path, remedy=remedy)


class _LoaderOfBytes(SourceFileLoader):
    """Runs source that was read before, so that what is hashed is what runs, even if the file changes meanwhile."""

    def __init__(self, name: str, path: str, content: bytes) -> None:
        super().__init__(name, path)
        self._content = content

    def get_data(self, path: str) -> bytes:
        return self._content

    def path_stats(self, path: str) -> Mapping[str, Any]:
        raise OSError  # so that no stored bytecode is run, nor any kept


def load_plugin(path: Path) -> None:
    """Run a plugin file, once in a process: it registers what it adds.

    Raises:
        PluginError: if there is no such file, it raises, or registers nothing or something that does not fit.
    """
    with _LOCK:
        if path in _loaded.files:
            return
        try:
            content = path.read_bytes()
        except OSError as error:
            remedy = "name a Python file"
            raise PluginError("the plugin cannot be read", got=error.strerror, where=path, remedy=remedy) from error
        name = MODULE_PREFIX + re.sub(r"\W", "_", path.stem)
        # What is hashed is what runs, even if the file changes meanwhile.
        loader = _LoaderOfBytes(name, str(path), content)
        spec = importlib.util.spec_from_file_location(name, path, loader=loader)
        if spec is None or path.suffix != ".py":
            raise PluginError("not a Python file", expected="a name that ends with .py", where=path)
        if name in sys.modules:
            raise PluginError("there is a plugin of this file name already", where=path, remedy="rename one of them")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        _loaded.files[path] = hashlib.sha256(content).hexdigest()
        before = _loaded.registered
        with _undone_if_it_raises():
            try:
                _run(functools.partial(loader.exec_module, module), path)
                if _loaded.registered == before:
                    remedy = "call register_detector, register_reader, register_label_format, ... at its end"
                    raise PluginError("the plugin registers nothing", where=path, remedy=remedy)
            except BaseException:
                del sys.modules[name], _loaded.files[path]
                raise


def discover_plugins() -> None:
    """Load the plugins of every kind that is known so far, so that what is wrong with one is said now.

    Raises:
        PluginError: if one cannot be loaded.
    """
    for registry in list(_registries):
        registry.complete()


@contextmanager
def forgotten_afterwards() -> Iterator[None]:
    """What is loaded and registered inside is forgotten at the end: for tests of plugins."""
    variable, files, entry_points = os.environ.get(PLUGINS_VARIABLE), dict(_loaded.files), set(_loaded.entry_points)
    modules = set(sys.modules)
    with _LOCK:
        kept = {id(registry): set(registry.registered()) for registry in _registries}
        _search_again()
    try:
        yield
    finally:
        with _LOCK:
            for registry in _registries:
                registry.keep_only(kept.get(id(registry), set()))
            _search_again()
            _loaded.files, _loaded.entry_points = files, entry_points
        for name in set(sys.modules) - modules:
            if name.startswith(MODULE_PREFIX):
                del sys.modules[name]
        os.environ.pop(PLUGINS_VARIABLE, None)
        if variable is not None:
            os.environ[PLUGINS_VARIABLE] = variable


def _search_again() -> None:
    _entry_points.cache_clear()
    for registry in _registries:
        registry._complete = False


@functools.cache
def _entry_points() -> Any:
    return importlib.metadata.entry_points()


def _load_entry_points(group: str) -> None:
    """An entry point names a module that registers, or a function without arguments that does."""
    for point in _entry_points().select(group=group):
        known = (group, point.name, point.value)
        if known in _loaded.entry_points:
            continue
        _loaded.entry_points.add(known)
        package = point.dist.name if point.dist is not None else "an installed package"

        def load(point: importlib.metadata.EntryPoint = point) -> None:
            found = point.load()
            if callable(found):
                found()

        with _undone_if_it_raises():
            try:
                _run(load, f"{package}, entry point {point.name} = {point.value}")
            except BaseException:
                _loaded.entry_points.discard(known)
                raise


def _run(act: Callable[[], object], where: object) -> None:
    """Run code of others; whatever it raises is one line that says where."""
    try:
        act()
    except RallyscopeError as error:
        raise PluginError(str(error), where=where) from error
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        last = ([frame for frame in frames if frame.filename == str(where)] or frames)[-1]
        line = f" ({last.filename}:{last.lineno})"
        got = f"{type(error).__name__}: {error}{line}"
        raise PluginError("the plugin raises", got=got, where=where, remedy="fix it, or leave it out") from error


@contextmanager
def _undone_if_it_raises() -> Iterator[None]:
    """What code registered before it raised is not kept."""
    before = {id(registry): set(registry.registered()) for registry in _registries}
    try:
        yield
    except BaseException:
        for registry in _registries:
            registry.keep_only(before.get(id(registry), set()))
        raise
