"""What a control asks for and waits for, off the loop."""

from __future__ import annotations

from collections.abc import Callable

from app.modes.mode import ModeHost
from core.errors import RallyscopeError


def do_in_pool(host: ModeHost, act: Callable[[], object]) -> None:
    """Do it in the pool; a RallyscopeError is shown to the person."""

    def work() -> None:
        try:
            act()
        except RallyscopeError as error:
            failed = error
            host.later(lambda: host.report(failed))

    host.pool.submit(work)
