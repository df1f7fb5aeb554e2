"""What came of a stroke, judged from the points of the chain alone: case, landing, height at the net, each with how
sure that is.
"""

from core.rally.outcomes.config import JudgeConfig
from core.rally.outcomes.judge import JudgedStroke, OutcomeJudge
from core.rally.outcomes.serve_seen import ServeSeen

__all__ = ["JudgeConfig", "JudgedStroke", "OutcomeJudge", "ServeSeen"]
