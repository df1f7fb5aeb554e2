"""Many independent pieces of work: in processes of this machine, or on a Dask cluster; the results are the same."""

from core.jobs.control import PieceControl, PiecesStoppedError
from core.jobs.engine import ALONE, HERE, Engine
from core.jobs.jobs import Jobs, open_jobs

__all__ = ["ALONE", "HERE", "Engine", "Jobs", "PieceControl", "PiecesStoppedError", "open_jobs"]
