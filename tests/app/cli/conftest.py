"""A verb that a test calls says only what it has to say, however slow the machine is."""

import pytest

from app.cli import progress


@pytest.fixture(autouse=True)
def _nothing_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a terminal work that lasts says how far it is: a line more on standard error after some seconds."""
    monkeypatch.setattr(progress, "QUIET_S", 1e6)
