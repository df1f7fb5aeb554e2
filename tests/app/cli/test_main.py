import subprocess
import sys

import pytest

from app.cli import main
from app.cli.main import VERBS
from tests.waiting import PATIENCE_S


def test_the_version_is_printed(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0 and capsys.readouterr().out.startswith("rallyscope ")


@pytest.mark.parametrize("arguments", [[], ["frobnicate"], ["info"], ["info", "a", "b"], ["detect", "--nonsense"]])
def test_bad_arguments_are_one_line_and_exit_2(arguments: list[str], capsys) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("rallyscope") and error.count("\n") == 1


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main([verb, "--help"])
    assert ended.value.code == 0
    assert "usage: rallyscope" in capsys.readouterr().out


def test_the_installed_script_returns_the_exit_code() -> None:
    code = "import sys; from app.cli import main; sys.exit(main(['info', 'no-such-file.h5']))"
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1 and "no-such-file.h5" in ended.stderr
