"""Learning to return: the one-step task, the paper's agent, agents beyond it and its rivals, and runs on disk.

The names below load without torch: a form, a table of runs or a live rally needs none. What trains is in
`core.learning.running`, and that loads it.
"""

from core.learning.config import RunConfig
from core.learning.control import Control, Status, read_status, write_control
from core.learning.policy import Policy
from core.learning.run_files import create_run, load_policy, read_run

__all__ = [
    "Control",
    "Policy",
    "RunConfig",
    "Status",
    "create_run",
    "load_policy",
    "read_run",
    "read_status",
    "write_control",
]
