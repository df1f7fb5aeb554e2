"""`python -m app.startup.demo FILE`: make the demo recording."""

from __future__ import annotations

import sys
from pathlib import Path

from app.background.child import give_way, send_to_parent
from core.errors import RallyscopeError
from core.files import end_with_parent
from core.simulation import ensure_demo


def main(path: Path) -> int:
    """Make the demo recording, and print the progress."""
    end_with_parent()
    give_way()
    reported = -1

    def tell(share: float) -> None:
        nonlocal reported
        if round(100 * share) > reported:
            reported = round(100 * share)
            send_to_parent(f"{reported} of 100")

    try:
        ensure_demo(path, tell)
    except RallyscopeError as error:
        send_to_parent(str(error))
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
