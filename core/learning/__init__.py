"""Learning to return: the one-step task, the paper's agent, agents beyond it and its rivals, and runs on disk.

The names below load without torch: a form, a table of runs or a live rally needs none. `run_training` and
`evaluate_run` are looked up when they are first used; only then is loaded what they need.
"""

from typing import TYPE_CHECKING

from core.learning.agents.policy import Policy
from core.learning.config import RunConfig, default_run
from core.learning.runs.run_files import (
    Control,
    RunStatus,
    create_run,
    load_policy,
    read_run,
    read_status,
    write_control,
)

if TYPE_CHECKING:
    from core.learning.runs.running import run_training
    from core.learning.runs.summary import evaluate_run

__all__ = [
    "Control",
    "Policy",
    "RunConfig",
    "RunStatus",
    "create_run",
    "default_run",
    "evaluate_run",
    "load_policy",
    "read_run",
    "read_status",
    "run_training",
    "write_control",
]


def __getattr__(name: str) -> object:
    if name == "run_training":
        from core.learning.runs.running import run_training

        return run_training
    if name == "evaluate_run":
        from core.learning.runs.summary import evaluate_run

        return evaluate_run
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
