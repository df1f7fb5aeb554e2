"""A robot is started, on a machine that may be busy: an answer that took too long is asked for again."""

import time

from core.errors import NoAnswerError
from core.robot import RobotClient

PATIENCE_S = 60.0


def start_until_answered(client: RobotClient) -> None:
    """As a person who presses Start again."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return client.start()
        except NoAnswerError:
            if time.monotonic() > deadline:
                raise
