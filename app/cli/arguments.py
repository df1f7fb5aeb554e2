"""The arguments of the verbs: frozen dataclasses whose fields say all of a flag, and the parsers made from them.

A verb is `run(arguments: ItsArguments)`. A field's type says how a word is read: a `Path`, `int`, `float` or `str`;
`Literal` for choices; `bool` for a switch, `bool | None` for one that can also be turned off (`--no-...`); a tuple of a
plain type for several words; `Annotated[kind, read]` for what `read` makes of a word. With `| None` it may be left out,
and is None then; so may a switch and what has a default. A field whose type is such a dataclass itself stands for all
of its flags, which stand under its `TITLE` in the help if it has one. A verb's description is the docstring.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NoReturn, TypeVar, get_args, get_origin, get_type_hints

from core.config import Bounds, field_spec
from core.errors import CommandError, RallyscopeError

A = TypeVar("A")
LARGEST_COUNT = 10**12
"""Largest number that is accepted: a time of eleven days in us."""
DATA = Path("rallyscope-data")
"""The workspace, unless `--data` names another."""


class Parser(argparse.ArgumentParser):
    """An argument parser that raises instead of printing usage; sub-parsers are of this class too.

    Options may stand anywhere between the names of files, as those of cp and git.
    """

    _mixing = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        # The parser of a verb is called by that of the program, which knows no intermixed arguments; these are read
        # by two calls of this method. What follows "--" may begin with a dash, which the second call would not know.
        if self._mixing or self._subparsers is not None or args is None or "--" in args:
            return super().parse_known_args(args, namespace)
        self._mixing = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._mixing = False

    def error(self, message: str) -> NoReturn:
        raise CommandError(message, where=self.prog, remedy=f"see `{self.prog} --help`")


def flag(
    what: str,
    metavar: str | None = None,
    default: object = None,
    *,
    choices: Iterable[object] | None = None,
    name: str | None = None,
    repeated: bool = False,
    within: tuple[type, str] | None = None,
) -> Any:
    """A field that is a flag: `--its-name`, unless it is given another `name`.

    Its help says the default. Of a field with `| None` that is what the verb takes for None. Of a tuple, all words
    follow the flag, unless it is `repeated`: then it is given again for each. It has the bounds of the config's field
    that `within` names.
    """
    settings = {"help": what, "metavar": metavar, "default": default, "choices": choices}
    bounds = None if within is None else field_spec(*within).bounds
    return dataclasses.field(metadata={"settings": settings, "name": name, "repeated": repeated, "bounds": bounds})


def setting_flag(config: type, setting: str, metavar: str | None = None, what: str = "") -> Any:
    """A flag that sets a field of a config, which says its default and, unless told otherwise, what it is."""
    spec = field_spec(config, setting)
    (item,) = (item for item in dataclasses.fields(config) if item.name == setting)
    registered = item.metadata.get("choices")  # of a text; those of a Literal are known by the field's type
    made = flag(what or spec.doc.removesuffix("."), metavar, spec.default, choices=registered)
    return dataclasses.field(metadata={**made.metadata, "bounds": spec.bounds})


def positional(what: str, metavar: str, *, choices: Iterable[object] | None = None) -> Any:
    """A field that is known by its place; with `| None` it may be left out."""
    return dataclasses.field(metadata={"settings": {"help": what, "metavar": metavar, "choices": choices}})


def one_of(flags: Mapping[str, tuple[str, str]]) -> Any:
    """A field (flag, value) for flags of which exactly one is given; help and metavar of each by its name."""
    return dataclasses.field(metadata={"one_of": flags})


def add_verb(parser: argparse.ArgumentParser, run: Callable[[A], None]) -> None:
    """Give a parser the arguments of a verb; its result's `run()` then runs the verb with them.

    Raises:
        CommandError: if what a plugin added has the name of another flag.
    """
    kind = arguments_of(run)
    parser.description = " ".join((kind.__doc__ or "").split())
    parser.usage = getattr(kind, "USAGE", None)
    try:
        add_arguments(parser, kind)
    except argparse.ArgumentError as error:
        remedy = "a plugin has taken the name of a flag: register what it adds by another name"
        raise CommandError("two flags of one name", got=error, where=parser.prog, remedy=remedy) from error
    parser.set_defaults(run=lambda parsed: run(read_arguments(kind, parsed)))


def arguments_of(run: Callable[[A], None]) -> type[A]:
    """The dataclass that a verb takes."""
    return get_type_hints(run)["arguments"]


def add_arguments(parser: argparse._ActionsContainer, kind: type) -> None:
    """All flags and positional arguments of a dataclass."""
    for item, hint in _fields(kind):
        if _is_group(hint):
            title = getattr(hint, "TITLE", None)
            add_arguments(parser.add_argument_group(title) if title else parser, hint)
        elif "one_of" in item.metadata:
            flags = parser.add_mutually_exclusive_group(required=True)
            for name, (what, metavar) in item.metadata["one_of"].items():
                flags.add_argument(f"--{name}", dest=name, type=get_args(hint)[1], metavar=metavar, help=what)
        else:
            _add_argument(parser, item, hint)


def read_arguments(kind: type[A], parsed: argparse.Namespace) -> A:
    """The dataclass with what was parsed."""
    values: dict[str, object] = {}
    for item, hint in _fields(kind):
        if _is_group(hint):
            values[item.name] = read_arguments(hint, parsed)
        elif "one_of" in item.metadata:
            asked = given({name: getattr(parsed, name) for name in item.metadata["one_of"]})
            values[item.name] = next(iter(asked.items()))
        else:
            value = getattr(parsed, item.name)
            values[item.name] = tuple(value) if isinstance(value, list) else value
    return kind(**values)


def _fields(kind: type) -> Iterator[tuple[dataclasses.Field[Any], Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return ((item, hints[item.name]) for item in dataclasses.fields(kind))


def _is_group(hint: object) -> bool:
    return dataclasses.is_dataclass(hint)


def _add_argument(parser: argparse._ActionsContainer, item: dataclasses.Field[Any], hint: Any) -> None:
    options: dict[str, Any] = given(item.metadata["settings"])
    optional = NoneType in get_args(hint)
    kind = next(part for part in get_args(hint) if part is not NoneType) if optional else hint
    default = options.get("default")
    if default is not None:
        options["help"] += f" (default: {default:g})" if isinstance(default, float) else f" (default: {default})"
    # argparse formats its help with %.
    options["help"] = options["help"].replace("%", "%%")
    if optional:
        # None must stay distinguishable from the default: it means that the flag was not given.
        options.pop("default", None)
    if kind is bool:
        options["action"] = argparse.BooleanOptionalAction if optional else "store_true"
    elif get_origin(kind) is Literal:
        options["choices"] = get_args(kind)
    elif get_origin(kind) is Annotated:
        options["type"] = _reader(kind.__metadata__[0], None)
    elif get_origin(kind) is tuple:
        many = {"action": "append"} if item.metadata.get("repeated") else {"nargs": "+"}
        options |= {"type": _reader(get_args(kind)[0], None), **many}
    else:
        options["type"] = _reader(kind, item.metadata.get("bounds"))
    if "name" not in item.metadata:
        options |= {"nargs": "?"} if optional else {}
        parser.add_argument(item.name, **options)
        return
    if not optional and default is None and kind is not bool:
        options["required"] = True
    parser.add_argument(f"--{item.metadata['name'] or item.name.replace('_', '-')}", dest=item.name, **options)


def _reader(kind: Callable[[str], Any], bounds: Bounds | None) -> Callable[[str], Any]:
    """Reads a word as argparse wants it: whatever is wrong with it is said with the name of the flag."""
    words = {int: "a whole number", float: "a number"}.get(kind)  # type: ignore[call-overload]

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except RallyscopeError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        except ValueError as error:
            if words is None:
                raise
            raise argparse.ArgumentTypeError(f"expected {words}, got {text!r}") from error
        if isinstance(value, float) and not math.isfinite(value):
            raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
        if bounds is not None and not bounds.low <= value <= bounds.high:
            raise argparse.ArgumentTypeError(f"expected {bounds.low:g} to {bounds.high:g}, got {text!r}")
        return value

    read.__name__ = getattr(kind, "__name__", "value")
    return read


def name_the_flag(error: RallyscopeError, words: Iterable[str]) -> RallyscopeError:
    """An error about a setting as one about the flag that set it, if one of the words is such a flag."""
    found = re.match(r"(?:[A-Z]\w*\.)?([a-z]\w*): ", str(error))
    if found is None:
        return error
    flags = {word.partition("=")[0] for word in words if word.startswith("--")}
    fits = [
        word
        for word in flags
        if f"{found[1]}_".startswith((f"{(name := word[2:].replace('-', '_'))}_", f"{name.removesuffix('s')}_"))
    ]
    return CommandError(str(error)[found.end() :], where=fits[0]) if len(fits) == 1 else error


def given(values: Mapping[str, A | None]) -> dict[str, A]:
    """The values that were given, without those that are None."""
    return {name: value for name, value in values.items() if value is not None}


def positive_int(text: str) -> int:
    """A whole number above 0."""
    return _integer(text, 1, "above 0")


def whole_number(text: str) -> int:
    """A whole number from 0."""
    return _integer(text, 0, "from 0")


def _integer(text: str, least: int, words: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if not least <= value <= LARGEST_COUNT:
        raise argparse.ArgumentTypeError(f"expected a whole number {words}, got {text!r}")
    return value


def positive_float(text: str) -> float:
    """A number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return value


def separated(read: Callable[[str], A], what: str) -> Callable[[str], tuple[A, ...]]:
    """Reads several of them with commas between."""

    def read_all(text: str) -> tuple[A, ...]:
        try:
            return tuple(read(part.strip()) for part in text.split(","))
        except (ValueError, argparse.ArgumentTypeError):
            raise argparse.ArgumentTypeError(f"expected {what} between commas, got {text!r}") from None

    return read_all


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def _name(text: str) -> str:
    if not text:
        raise ValueError
    return text


WholeNumber = Annotated[int, whole_number]
PositiveInt = Annotated[int, positive_int]
PositiveFloat = Annotated[float, positive_float]
Numbers = Annotated[tuple[float, ...], separated(_finite, "numbers")]
Counts = Annotated[tuple[int, ...], separated(positive_int, "whole numbers above 0")]
Names = Annotated[tuple[str, ...], separated(_name, "names")]
