"""Many independent tasks, in processes of this machine or on a Dask cluster, with equal results."""

from core.jobs.control import TaskControl, TasksStoppedError
from core.jobs.jobs import ALONE, HERE, JobBackend, Jobs, open_jobs

__all__ = ["ALONE", "HERE", "JobBackend", "Jobs", "TaskControl", "TasksStoppedError", "open_jobs"]
