"""Where a verb does its many pieces of work: the same two flags for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from app.cli.arguments import PositiveInt, flag
from core.jobs import JobBackend


@dataclass(frozen=True, slots=True, kw_only=True)
class BackendArguments:
    """Flags of a verb whose tasks are sent to workers and whose results come back."""

    TITLE: ClassVar = "parallel work, with the same results anywhere"
    jobs: PositiveInt | None = flag("parallel jobs on this machine", "N", "one per core")
    cluster: str | None = flag(
        "scheduler of a Dask cluster that runs the jobs instead; on another machine tls://",
        "tcp://HOST:PORT",
    )

    def engine(self) -> JobBackend:
        """What was asked for.

        Raises:
            JobsError: for both flags, or an address that is none of a cluster, or one of a plain one elsewhere.
        """
        return JobBackend(jobs=self.jobs, cluster=self.cluster)


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedBackendArguments(BackendArguments):
    """Flags of a verb whose workers open and write the files themselves."""

    TITLE: ClassVar = (
        "parallel work, with the same results anywhere; the machines of a cluster must share the folders of all "
        "files that are read or written, under the same paths"
    )
