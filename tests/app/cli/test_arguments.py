from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest

from app.cli.arguments import (
    Counts,
    Names,
    Numbers,
    Parser,
    PositiveInt,
    add_arguments,
    add_verb,
    flag,
    one_of,
    positional,
    read_arguments,
    setting_flag,
)
from app.cli.main import main
from core.config import setting
from core.errors import CommandError


@dataclass(frozen=True, slots=True, kw_only=True)
class Racket:
    weight_g: float = setting(180.0, 100.0, 250.0)
    """100 % of it, handle included."""
    grip: Literal["shakehand", "penhold"] = "shakehand"
    layers: int = setting(5, 1, 9)
    """Sheets of wood."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BallArguments:
    """Of the ball."""

    TITLE: ClassVar = "the ball"
    balls: PositiveInt = flag("how many", "N", 3)
    spin: bool | None = flag("with or without spin")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayArguments:
    """Play a match, and
    write it down.
    """

    table: Path = positional("where to play", "TABLE")
    hall: Path | None = positional("around it", "HALL")
    weight_g: float = setting_flag(Racket, "weight_g", "G")
    layers: int | None = setting_flag(Racket, "layers", "N")
    ball: BallArguments
    players: Names | None = flag("who", "NAME,NAME")
    speeds: Numbers = flag("how fast", "MPS,...", (5.0, 7.5))
    games: Counts | None = flag("how long", "N,N", "until dark")
    style: Literal["attack", "defence"] = flag("how", default="attack")
    rubbers: tuple[Path, ...] | None = flag("what with", "FILE")
    quiet: bool = flag("say nothing")
    out: Path = flag("the record", "CSV", name="to")


def parsed(*words: str) -> PlayArguments:
    parser = Parser(prog="play")
    add_arguments(parser, PlayArguments)
    return read_arguments(PlayArguments, parser.parse_args(words))


LEAST = ("blue", "--to", "a.csv")


def test_what_is_not_given_is_the_default_of_its_field_or_of_the_config() -> None:
    assert parsed(*LEAST) == PlayArguments(
        table=Path("blue"),
        hall=None,
        weight_g=180.0,
        layers=None,
        ball=BallArguments(balls=3, spin=None),
        players=None,
        speeds=(5.0, 7.5),
        games=None,
        style="attack",
        rubbers=None,
        quiet=False,
        out=Path("a.csv"),
    )


def test_words_are_read_as_the_types_of_the_fields() -> None:
    words = "blue hall --weight-g 150.5 --layers 7 --balls 9 --spin --players anna,bea --speeds 3,4.5 --games 11,21"
    words += " --style defence --rubbers red black --quiet --to a.csv"
    assert parsed(*words.split()) == PlayArguments(
        table=Path("blue"),
        hall=Path("hall"),
        weight_g=150.5,
        layers=7,
        ball=BallArguments(balls=9, spin=True),
        players=("anna", "bea"),
        speeds=(3.0, 4.5),
        games=(11, 21),
        style="defence",
        rubbers=(Path("red"), Path("black")),
        quiet=True,
        out=Path("a.csv"),
    )


def test_a_switch_with_three_states_can_be_turned_off() -> None:
    assert [parsed(*LEAST, *more).ball.spin for more in ([], ["--spin"], ["--no-spin"])] == [None, True, False]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--to", "a.csv"], "required: TABLE"),
        (["blue"], "required: --to"),
        ([*LEAST, "--weight-g", "heavy"], "--weight-g: expected a number, got 'heavy'"),
        ([*LEAST, "--balls", "0"], "--balls: expected a whole number above 0, got '0'"),
        ([*LEAST, "--players", "anna,"], "--players: expected names between commas"),
        ([*LEAST, "--speeds", "3,fast"], "--speeds: expected numbers between commas"),
        ([*LEAST, "--games", "11,0"], "--games: expected whole numbers above 0 between commas"),
        ([*LEAST, "--style", "chess"], "--style: invalid choice: 'chess'"),
        ([*LEAST, "--rubbers"], "--rubbers: expected at least one argument"),
        ([*LEAST, "--out", "b.csv"], "--out"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_flag(words: list[str], says: str) -> None:
    with pytest.raises(CommandError, match="see `play --help`") as error:
        parsed(*words)
    assert says in str(error.value) and "\n" not in str(error.value)


def help_of(kind: type) -> str:
    parser = Parser(prog="play", formatter_class=lambda prog: Parser().formatter_class(prog, width=200))
    add_arguments(parser, kind)
    return parser.format_help()


def test_the_help_says_what_the_field_or_the_config_says() -> None:
    text = help_of(PlayArguments)
    for line in (
        "--weight-g G",
        "100 % of it, handle included (default: 180)",
        "Sheets of wood (default: 5)",
        "how long (default: until dark)",
        "how (default: attack)",
        "the ball:\n  --balls N",
    ):
        assert line in text
    assert "(default: False)" not in text and "(default: None)" not in text


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawArguments:
    """Draw."""

    to: tuple[str, Path] = one_of({"png": ("a picture", "F"), "csv": ("a table", "DIR")})


def test_of_several_flags_exactly_one_is_given() -> None:
    parser = Parser(prog="draw")
    add_arguments(parser, DrawArguments)
    assert read_arguments(DrawArguments, parser.parse_args(["--csv", "a"])) == DrawArguments(to=("csv", Path("a")))
    for words in ([], ["--csv", "a", "--png", "b"]):
        with pytest.raises(CommandError):
            parser.parse_args(words)


def test_a_verb_is_described_by_its_arguments_and_run_with_them() -> None:
    seen = []

    def run(arguments: PlayArguments) -> None:
        seen.append(arguments)

    parser = Parser(prog="play")
    add_verb(parser, run)
    assert parser.description == "Play a match, and write it down."
    namespace = parser.parse_args(LEAST)
    namespace.run(namespace)
    assert seen == [parsed(*LEAST)]


def shout(text: str) -> str:
    return text.upper()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShoutArguments:
    """Shout."""

    word: Annotated[str, shout] | None = flag("what")


def test_a_type_of_its_own_reads_the_word() -> None:
    parser = Parser()
    add_arguments(parser, ShoutArguments)
    assert read_arguments(ShoutArguments, parser.parse_args(["--word", "ball"])).word == "BALL"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("simulate --out {new} --noise-hz -1", "rallyscope simulate: argument --noise-hz: expected 0 to 20, got '-1'"),
        ("simulate --out {new} --speed 900", "rallyscope simulate: argument --speed: expected 3 to 9, got '900'"),
        ("train --out {new} --speeds 0", "--speeds: no serve of this speed; expected 3 to 9 m/s, got (0.0,)"),
        ("sim-server --auto-serve 900", "rallyscope sim-server: argument --auto-serve: expected 0 to 9, got '900'"),
        (
            "import {csv} {other} {new} --offset-us 99999999999999999999999",
            "--offset-us: no such offset; expected at most",
        ),
        (
            "import {csv} --check --width 99999 --height 5",
            "--width and --height: impossible sensor size; expected",
        ),
    ],
)
def test_a_message_about_a_setting_names_the_flag_that_set_it(tmp_path, capsys, words, message) -> None:
    (tmp_path / "a.csv").write_text("t,x,y,p\n1,2,3,1\n2,3,4,0\n")
    (tmp_path / "b.csv").write_text("t,x,y,p\n1,2,3,1\n2,3,4,0\n")
    filled = words.format(new=tmp_path / "new", csv=tmp_path / "a.csv", other=tmp_path / "b.csv")
    assert main(filled.split()) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"rallyscope: {message}") and err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "b.csv"]
