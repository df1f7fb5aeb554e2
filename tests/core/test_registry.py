"""Registries, and the plugins that add to them."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from core.errors import PluginError
from core.registry import (
    MODULE_PREFIX,
    PLUGINS_VARIABLE,
    Registry,
    forgotten_afterwards,
    load_plugin,
    load_same_plugins,
    plugin_hashes,
    use_plugins,
)

COLOURS: Registry[int] = Registry("colour", "rallyscope.test_colours")
COLOURS.register("red", 1)
COLOURS.register("green", 2)
COLOURS.mark_built_in()
ADD = f"import sys\ncolours = sys.modules[{__name__!r}].COLOURS\n"


@pytest.fixture(autouse=True)
def findable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The plugins of these tests find this module, which pytest imports by its path."""
    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__) or type(sys)(__name__))
    monkeypatch.setattr(sys.modules[__name__], "COLOURS", COLOURS, raising=False)
    with forgotten_afterwards():
        yield


def plugin(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(ADD + text)
    return path


def test_a_registered_thing_is_found_by_name_after_ours(tmp_path: Path) -> None:
    squares = COLOURS.view(lambda number: number**2, where=lambda number: number > 1, key=str.upper)
    use_plugins([plugin(tmp_path, "colours.register('sky-blue', 3)")])
    assert list(COLOURS.items()) == [("red", 1), ("green", 2), ("sky-blue", 3)]
    assert dict(squares) == {"GREEN": 4, "SKY-BLUE": 9} and "RED" not in squares and len(squares) == 2
    assert COLOURS.is_built_in("red") and not COLOURS.is_built_in("sky-blue")


@pytest.mark.parametrize("name", ["", "Red", "light blue", "-red", "a" * 41, "../red", "é", 3])
def test_what_is_no_name_is_refused(name) -> None:
    with pytest.raises(PluginError, match="not a name of a colour; expected small letters"):
        COLOURS.register(name, 3)


def test_a_name_that_is_taken_is_refused_and_ours_stays(tmp_path: Path) -> None:
    path = plugin(tmp_path, "colours.register('blue', 3)\ncolours.register('red', 4)")
    with pytest.raises(PluginError, match=r"mine\.py: there is a colour 'red' already; register it by another name"):
        use_plugins([path])
    assert dict(COLOURS) == {"red": 1, "green": 2}, "nothing of a plugin that fails is kept"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 / 0", r"the plugin raises; got ZeroDivisionError: division by zero \(.*mine\.py:3\); fix it"),
        ("import no_such_module", r"got ModuleNotFoundError: No module named 'no_such_module' \(.*mine\.py:3\)"),
        ("def broken(:", "got SyntaxError: .*line 3"),
        ("raise SystemExit(0)", "the plugin raises; got SystemExit: 0"),
        ("", "the plugin registers nothing; call register_detector"),
    ],
)
def test_a_plugin_that_cannot_be_used_is_one_line_and_can_be_loaded_when_it_was_fixed(
    tmp_path: Path, text: str, said: str
) -> None:
    path = plugin(tmp_path, text)
    for _ in range(2):
        with pytest.raises(PluginError, match=said) as error:
            use_plugins([path])
        assert "\n" not in str(error.value) and str(path) in str(error.value)
    assert PLUGINS_VARIABLE not in os.environ and f"{MODULE_PREFIX}mine" not in sys.modules
    use_plugins([plugin(tmp_path, "colours.register('blue', 3)  # fixed, and of another length")])
    assert COLOURS["blue"] == 3


def test_a_file_that_is_not_there_or_no_python_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"mine\.py: the plugin cannot be read; got No such file"):
        use_plugins([tmp_path / "mine.py"])
    with pytest.raises(PluginError, match=r"not a Python file; expected a name that ends with \.py"):
        use_plugins([plugin(tmp_path, "", "mine.txt")])


def test_two_files_of_one_name_are_refused_and_one_file_twice_is_loaded_once(tmp_path: Path) -> None:
    path = plugin(tmp_path, "colours.register('blue', 3)")
    use_plugins([path, path])
    (tmp_path / "b").mkdir()
    with pytest.raises(PluginError, match="there is a plugin of this file name already"):
        use_plugins([plugin(tmp_path / "b", "colours.register('grey', 4)")])


def test_the_environment_names_plugins_for_whoever_first_asks(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv(PLUGINS_VARIABLE, str(plugin(tmp_path, "colours.register('blue', 3)")))
    assert COLOURS.registered() == {"red": 1, "green": 2}
    assert COLOURS["green"] == 2 and f"{MODULE_PREFIX}mine" not in sys.modules, "ours are there without a search"
    assert COLOURS["blue"] == 3 and f"{MODULE_PREFIX}mine" in sys.modules


def test_a_process_that_is_started_gets_all_of_them(tmp_path: Path) -> None:
    one = plugin(tmp_path, "colours.register('blue', 3)", "one.py")
    two = plugin(tmp_path, "colours.register('grey', 4)", "two.py")
    use_plugins([one])
    use_plugins([two])
    assert os.environ[PLUGINS_VARIABLE].split(os.pathsep) == [str(one), str(two)]


def test_a_worker_elsewhere_must_have_the_same_file(tmp_path: Path) -> None:
    path = plugin(tmp_path, "colours.register('blue', 3)")
    use_plugins([path])
    there = plugin_hashes()
    load_same_plugins(there)
    with pytest.raises(PluginError, match=r"mine\.py: a worker has another version of this plugin; let all machines"):
        load_same_plugins({str(path): "0" * 64})


def test_what_runs_is_what_is_hashed_and_no_code_that_python_kept(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path = plugin(tmp_path, "colours.register('blue', 3)\n")
    times = (1_000_000_000, 1_000_000_000)
    os.utime(path, times)
    with forgotten_afterwards():
        load_plugin(path)
    plugin(tmp_path, "colours.register('blue', 4)\n")  # of the same length, and as old as the one before
    os.utime(path, times)
    with forgotten_afterwards():
        load_plugin(path)
        assert COLOURS["blue"] == 4
    assert not list(tmp_path.glob("**/*.pyc"))


def test_an_entry_point_is_a_module_or_a_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_module.py").write_text(ADD + "colours.register('teal', 5)")
    (tmp_path / "their_function.py").write_text(ADD + "def add():\n    colours.register('pink', 6)")
    write_package(tmp_path, "one = their_module\ntwo = their_function:add")
    monkeypatch.syspath_prepend(tmp_path)
    with forgotten_afterwards():
        assert dict(COLOURS) == {"red": 1, "green": 2, "teal": 5, "pink": 6}
    del sys.modules["their_module"], sys.modules["their_function"]


def test_a_broken_entry_point_says_of_which_package_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_package(tmp_path, "one = module_that_is_not_there")
    monkeypatch.syspath_prepend(tmp_path)
    with forgotten_afterwards():
        for _ in range(2):
            with pytest.raises(
                PluginError, match="theirs, entry point one = module_that_is_not_there: the plugin raises"
            ):
                list(COLOURS)
        assert COLOURS["red"] == 1


def write_package(folder: Path, entries: str) -> None:
    info = folder / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{COLOURS.group}]\n{entries}\n")


def test_what_was_loaded_in_a_test_is_forgotten(tmp_path: Path) -> None:
    with forgotten_afterwards():
        load_plugin(plugin(tmp_path, "colours.register('blue', 3)"))
        assert "blue" in COLOURS
    assert "blue" not in COLOURS and f"{MODULE_PREFIX}mine" not in sys.modules
