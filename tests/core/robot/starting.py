"""A robot is started, on a machine that may be busy: an answer that took too long is asked for again, a robot that was
lost meanwhile is waited for.
"""

from core.errors import NoAnswerError, TargetRefusedError
from core.robot import RobotClient
from tests.waiting import eventually


def start_until_answered(client: RobotClient) -> None:
    """As a person who presses Start again."""

    def answered() -> bool:
        try:
            client.start()
        except NoAnswerError:
            return False
        except TargetRefusedError as refused:
            if refused.why != "lost":
                raise
            return False
        return True

    eventually(answered, "an answer to Start", lambda: client.status)
