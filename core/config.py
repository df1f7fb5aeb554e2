"""Frozen config dataclasses as the single home of every threshold: bounds, documentation, TOML files and form fields.

A config is a `@dataclass(frozen=True, slots=True, kw_only=True)` whose fields are made with `setting` (numbers with
bounds), are plain `bool` or `Literal` choices, or are configs themselves. A string literal under a field documents it.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import itertools
import math
import textwrap
import types
import typing
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from core.errors import WRITE_REMEDY, ConfigError
from core.files import replace_file
from core.text import parse_toml

C = typing.TypeVar("C")
Sections = tuple[tuple[str, object], ...]
"""Name and config of each section that is not as it comes, by name: the value of a field made with `open_sections`."""
PLUGIN_REMEDY: typing.Final = "if it comes with a plugin, name that with --plugin"
LARGEST_FILE_BYTES: typing.Final = 1 << 20
"""A config is a few kilobytes."""
Setting = bool | int | float | str | tuple[float, ...]
"""The value of a leaf."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Closed interval of a numeric setting and the step a slider moves it by."""

    low: float
    high: float
    step: float


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """One leaf of a config, as a form or a file needs it."""

    path: tuple[str, ...]
    """Section names and field name, outermost first: ("cluster", "eps_px")."""
    kind: type
    """bool, int, float or str; of a list, of its items."""
    default: Setting
    bounds: Bounds | None
    """Bounds of an int or a float; None for a bool or a choice."""
    choices: tuple[str, ...]
    """Choices of a str; empty otherwise."""
    doc: str
    is_list: bool = False
    """A tuple of any length."""
    stage: str = ""
    """Stage of the method that uses it, where a section holds the settings of several."""


def setting(default: float, low: float, high: float, *, step: float | None = None, stage: str = "") -> typing.Any:
    """A numeric config field with `low <= value <= high`; `check_settings` enforces it, sliders use it.

    `stage` puts its slider under a heading of its own: the fields of a stage stand together.

    Args:
        default: value of the field; a whole number makes a field of whole numbers.
        low: smallest value.
        high: largest value.
        step: of the slider; None: 1, or a 200th of the range.
        stage: heading under which the slider stands.
    """
    if step is None:
        step = 1 if isinstance(default, int) else (high - low) / 200
    return dataclasses.field(default=default, metadata={"bounds": Bounds(low, high, step), "stage": stage})


def choice(default: str, offered: Collection[str]) -> typing.Any:
    """A text field whose choices are registered: `offered` is asked whenever one is checked or shown."""
    return dataclasses.field(default=default, metadata={"choices": offered})


def open_sections(types: Mapping[str, type]) -> typing.Any:
    """A field for sections that are registered: each stands in files and forms beside the declared ones.

    `types` has the config of each by its name and is asked whenever one is needed. A name that is declared as a field
    is that field. Call `normal_sections` from `__post_init__`.
    """
    return dataclasses.field(default=(), metadata={"sections": types})


def normal_sections(config: object) -> None:
    """Sections in order of their names, without those that are as they come, so that equal configs are equal.

    Raises:
        ConfigError: for a section that is not registered, or of another type.
    """
    found = _open_field(type(config))
    assert found is not None, f"{type(config).__name__} has no open sections"
    item, types = found
    sections: dict[str, object] = {}
    for name, section in getattr(config, item.name):
        if name not in types or not isinstance(section, types[name]):
            raise ConfigError(f"no section {name!r} of this kind", expected=_known(type(config)), got=repr(section))
        check_settings(section)  # also where its class does not check itself
        if section != types[name]():
            sections[name] = section
    object.__setattr__(config, item.name, tuple(sorted(sections.items())))


def check_config_type(config: object, where: str) -> None:
    """Check that sliders and files can be made of a config's fields: for configs that a plugin registers.

    Raises:
        ConfigError: if it is not a frozen dataclass with a default for each field, and bounds for each number.
    """
    expected = "a class with @dataclass(frozen=True), a default and bounds for each field, see core.config.setting"
    params = getattr(config, "__dataclass_params__", None)
    if not isinstance(config, type) or params is None or not params.frozen:
        raise ConfigError("no config", expected=expected, got=repr(config), where=where)
    try:
        config()
        specs = field_specs(config)
    except (AssertionError, NameError, TypeError) as error:
        raise ConfigError("not a config", expected=expected, got=error, where=where) from error
    for spec in specs:
        if spec.bounds is None and spec.kind is not bool and not spec.choices and not spec.is_list:
            raise ConfigError(f"the setting {'.'.join(spec.path)} has no bounds", expected=expected, where=where)


def _open_field(config_type: type) -> tuple[dataclasses.Field[typing.Any], Mapping[str, type]] | None:
    """The field of a config that holds its registered sections, and their types."""
    for item in dataclasses.fields(config_type):
        if "sections" in item.metadata:
            return item, item.metadata["sections"]
    return None


def _registered_sections(config_type: type) -> dict[str, type]:
    found = _open_field(config_type)
    if found is None:
        return {}
    declared = _declared(config_type)
    return {name: kind for name, kind in found[1].items() if name not in declared}


def _declared(config_type: type) -> set[str]:
    return {item.name for item in dataclasses.fields(config_type)}


def _known(config_type: type) -> str:
    """What a table of this config may hold."""
    declared = [item.name for item in dataclasses.fields(config_type) if "sections" not in item.metadata]
    return f"one of {', '.join([*declared, *_registered_sections(config_type)])}"


def check_settings(config: object) -> None:
    """Check every field of a config against its type and bounds; call it from `__post_init__`.

    Raises:
        ConfigError: naming the field, what was expected and what it got.
    """
    assert dataclasses.is_dataclass(config)
    hints = _type_hints(type(config))
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        where = f"{type(config).__name__}.{item.name}"
        kind = hints[item.name]
        if "sections" in item.metadata:
            normal_sections(config)
            continue
        if kind is float:
            # In Python a bool is an int.
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not _is_finite(value):
                raise ConfigError("not a finite number", expected="float", got=repr(value), where=where)
        elif kind is int:
            if isinstance(value, bool) or not isinstance(value, int):
                raise ConfigError("not a whole number", expected="int", got=repr(value), where=where)
        elif kind is bool:
            if not isinstance(value, bool):
                raise ConfigError("not a truth value", expected="true or false", got=repr(value), where=where)
        elif kind is str and not isinstance(value, str):
            raise ConfigError("not a text", expected="str", got=repr(value), where=where)
        elif kind is str and value not in item.metadata.get("choices", (value,)):
            choices = " | ".join(item.metadata["choices"])
            raise ConfigError(
                "not one of the choices", expected=choices, got=repr(value), where=where, remedy=PLUGIN_REMEDY
            )
        elif typing.get_origin(kind) is typing.Literal and value not in typing.get_args(kind):
            choices = " | ".join(map(str, typing.get_args(kind)))
            raise ConfigError("not one of the choices", expected=choices, got=repr(value), where=where)
        elif typing.get_origin(kind) is tuple:
            _check_list(value, typing.get_args(kind)[0], where)
        bounds = item.metadata.get("bounds")
        if bounds is not None and not bounds.low <= value <= bounds.high:
            raise ConfigError("out of range", expected=f"{bounds.low:g} to {bounds.high:g}", got=value, where=where)


def _check_list(values: object, kind: type, where: str) -> None:
    """A file gives a list where a config holds a tuple."""
    if not isinstance(values, (tuple, list)):
        raise ConfigError("not a list", expected=f"[{kind.__name__}, ...]", got=repr(values), where=where)
    allowed = (int, float) if kind is float else (kind,)
    for value in values:
        if isinstance(value, bool) is not (kind is bool) or not isinstance(value, allowed):
            raise ConfigError("not a list of such values", expected=kind.__name__, got=repr(value), where=where)
        if isinstance(value, (int, float)) and not _is_finite(value):
            raise ConfigError("not a finite number", expected=kind.__name__, got=repr(value), where=where)


def field_specs(config_type: type, *, prefix: tuple[str, ...] = ()) -> tuple[FieldSpec, ...]:
    """Every leaf field of a config type, nested configs flattened in order of declaration, registered sections last."""
    hints = _type_hints(config_type)
    specs: list[FieldSpec] = []
    for item in dataclasses.fields(config_type):
        kind = hints[item.name]
        if "sections" in item.metadata:
            continue
        if dataclasses.is_dataclass(kind):
            specs.extend(field_specs(typing.cast(type, kind), prefix=(*prefix, item.name)))
        else:
            specs.append(field_spec(config_type, item.name, prefix=prefix))
    for name, kind in _registered_sections(config_type).items():
        specs.extend(field_specs(kind, prefix=(*prefix, name)))
    return tuple(specs)


def field_spec(config_type: type, name: str, *, prefix: tuple[str, ...] = ()) -> FieldSpec:
    """One leaf field of a config type."""
    kind = _type_hints(config_type)[name]
    item = next(item for item in dataclasses.fields(config_type) if item.name == name)
    choices: tuple[str, ...] = tuple(item.metadata.get("choices", ()))
    if typing.get_origin(kind) is typing.Literal:
        choices, kind = typing.get_args(kind), str
    is_list = typing.get_origin(kind) is tuple
    if is_list:
        kind = typing.get_args(kind)[0]
    default = item.default
    assert isinstance(default, (bool, int, float, str, tuple)), f"{config_type.__name__}.{name} needs a plain default"
    bounds, doc = item.metadata.get("bounds"), _field_docs(config_type).get(name, "")
    return FieldSpec((*prefix, name), kind, default, bounds, choices, doc, is_list, item.metadata.get("stage", ""))


def get_setting(config: object, path: tuple[str, ...]) -> Setting:
    """The value of the leaf at `path`."""
    for name in path:
        config = get_section(config, name)
    return typing.cast(Setting, config)


def get_section(config: object, name: str) -> typing.Any:
    """A section of a config, or a field: declared, or registered.

    Raises:
        ConfigError: if there is none of this name.
    """
    if name in _declared(type(config)):
        return getattr(config, name)
    types = _registered_sections(type(config))
    if name not in types:
        raise ConfigError(f"no section or setting {name!r}", expected=_known(type(config)), remedy=PLUGIN_REMEDY)
    return dict(_sections_of(config)).get(name, types[name]())


def _sections_of(config: object) -> Sections:
    found = _open_field(type(config))
    return () if found is None else getattr(config, found[0].name)


def replace_setting(config: C, path: tuple[str, ...], value: Setting) -> C:
    """A copy of the config with the leaf at `path` set to `value`.

    Raises:
        ConfigError: if the value is not allowed there.
    """
    head, *rest = path
    child = replace_setting(get_section(config, head), tuple(rest), value) if rest else value
    found = None if head in _declared(type(config)) else _open_field(type(config))
    if found is not None:
        head, child = found[0].name, tuple({**dict(_sections_of(config)), head: child}.items())
    return dataclasses.replace(typing.cast(typing.Any, config), **{head: child})


def config_to_mapping(config: object) -> dict[str, object]:
    """Nested plain dictionaries of a config, ready for TOML or JSON. Registered sections only if they were changed, so
    that a file opens without a plugin that it does not need.
    """
    mapping: dict[str, object] = {}
    for item in dataclasses.fields(typing.cast(typing.Any, config)):
        value = getattr(config, item.name)
        if "sections" in item.metadata:
            mapping |= {name: config_to_mapping(section) for name, section in value}
        else:
            mapping[item.name] = config_to_mapping(value) if dataclasses.is_dataclass(value) else value
    return mapping


def config_from_mapping(config_type: type[C], mapping: object, *, where: str) -> C:
    """A config from nested dictionaries; fields that are absent keep their defaults.

    Raises:
        ConfigError: on an unknown key, a wrong type or a value out of range; `where` names the source.
    """
    if not isinstance(mapping, dict):
        raise ConfigError("not a table of settings", expected="[section] with keys", got=repr(mapping), where=where)
    hints = dict(_type_hints(config_type))
    found, sections, values = _open_field(config_type), dict[str, object](), dict[str, object]()
    if found is not None:
        del hints[found[0].name]
    for key, value in mapping.items():
        if key not in hints:
            types = _registered_sections(config_type)
            if key not in types:
                remedy = PLUGIN_REMEDY if found is not None else None
                raise ConfigError(f"unknown setting {key!r}", expected=_known(config_type), where=where, remedy=remedy)
            sections[key] = config_from_mapping(types[key], value, where=f"{where} [{key}]")
            continue
        kind = hints[key]
        if dataclasses.is_dataclass(kind):
            values[key] = config_from_mapping(typing.cast(type, kind), value, where=f"{where} [{key}]")
        elif kind is float and isinstance(value, int) and not isinstance(value, bool):
            values[key] = float(value) if _is_finite(value) else math.inf  # one of hundreds of digits: refused below
        else:
            values[key] = value
    if found is not None and sections:
        values[found[0].name] = tuple(sections.items())
    try:
        return config_type(**values)
    except ConfigError as error:
        raise ConfigError(str(error), where=where) from error


def load_config(config_type: type[C], path: Path) -> C:
    """A config from a TOML file.

    Raises:
        ConfigError: if the file is missing, is not TOML, or holds a setting that does not fit.
    """
    return config_from_mapping(config_type, read_mapping(path), where=str(path))


def read_mapping(path: Path) -> dict[str, typing.Any]:
    """The tables of a TOML file of settings.

    Raises:
        ConfigError: if the file is missing, too large, or not TOML.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            raise ConfigError("too large for a config", expected="at most 1 MiB", got=f"{size} bytes", where=path)
        return parse_toml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError("cannot read the config", got=error.strerror, where=path) from error
    except ValueError as error:
        raise ConfigError("not a TOML file", got=str(error), where=path) from error


def save_config(config: object, path: Path) -> None:
    """Write a config as TOML, replacing the file in one step.

    Raises:
        ConfigError: if the folder cannot be written.
    """
    write_mapping(config_to_mapping(config), path)


def write_mapping(mapping: dict[str, object], path: Path) -> None:
    """Write settings as TOML, replacing the file in one step.

    Raises:
        ConfigError: if the folder cannot be written.
    """
    try:
        replace_file(path, tomli_w.dumps(mapping).encode(), durable=True)
    except OSError as error:
        raise ConfigError("cannot write the config", got=error.strerror, where=path, remedy=WRITE_REMEDY) from error


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number of hundreds of digits
        return False


@functools.cache
def _type_hints(config_type: type) -> dict[str, typing.Any]:
    return typing.get_type_hints(config_type)


@functools.cache
def _field_docs(config_type: type) -> types.MappingProxyType[str, str]:
    """Field name -> the string literal under it, read from the class's source."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(config_type)))
    except (OSError, TypeError):  # a class that was typed in has no source
        return types.MappingProxyType({})
    body = typing.cast(ast.ClassDef, tree.body[0]).body
    docs: dict[str, str] = {}
    for statement, below in itertools.pairwise(body):
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
            and isinstance(below.value.value, str)
        ):
            docs[statement.target.id] = " ".join(below.value.value.split())
    return types.MappingProxyType(docs)
