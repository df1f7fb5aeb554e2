"""The token is known to the gateway and to the line that is printed at the start, and goes nowhere else."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from app.cli import main
from app.cli.serve import page_url
from app.web.access_policy import Admission

APP = Path(__file__).parents[3] / "app"
KNOW = {"web/access_policy.py", "web/gateway.py", "cli/serve.py"}


def test_only_the_gateway_and_the_first_line_know_the_token() -> None:
    for path in APP.rglob("*.py"):
        read = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
        assert not {"token", "is_token"} & read or path.relative_to(APP).as_posix() in KNOW, path


def test_the_first_line_has_it_and_nothing_else_of_the_link() -> None:
    token = "a-token-for-this-test"
    assert page_url("10.0.0.1", 8080, Admission(local=False, token=token)) == f"http://10.0.0.1:8080/?token={token}"
    assert "token" not in page_url("127.0.0.1", 8080, Admission())


def test_a_token_that_is_refused_is_not_quoted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--token", "hunter2", "--data", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "token" in error and "hunter2" not in error


def test_who_comes_in_is_not_told_the_token_by_the_cookie() -> None:
    rules = Admission(local=False, token="a-token-for-this-test")
    assert "a-token" not in rules.cookie
