"""Learning to return: the one-step task, the paper's agent, agents beyond it and its rivals, and runs on disk.

The names below load without torch: a form, a table of runs or a live rally needs none. What computes with it is
looked up when it is first used; only then is loaded what it needs.
"""

import importlib
from typing import TYPE_CHECKING, Final

from core.learning.agents.policy import Policy
from core.learning.config import RunConfig, default_run
from core.learning.runs.control import Control, RunStatus, read_status, write_control
from core.learning.runs.run_files import create_run, load_policy, read_run

if TYPE_CHECKING:
    from core.learning.event_windows import EventWindows, collate_windows, count_pictures
    from core.learning.runs.running import run_training
    from core.learning.runs.summary import evaluate_run

__all__ = [
    "Control",
    "EventWindows",
    "Policy",
    "RunConfig",
    "RunStatus",
    "collate_windows",
    "count_pictures",
    "create_run",
    "default_run",
    "evaluate_run",
    "load_policy",
    "read_run",
    "read_status",
    "run_training",
    "write_control",
]
_LATER: Final = {
    "EventWindows": "core.learning.event_windows",
    "collate_windows": "core.learning.event_windows",
    "count_pictures": "core.learning.event_windows",
    "evaluate_run": "core.learning.runs.summary",
    "run_training": "core.learning.runs.running",
}


def __getattr__(name: str) -> object:
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
